"""Questions to a run and its answers: what is promised is there and of its kind, or a sentence says what is not."""

from __future__ import annotations

import json

import msgpack
import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.control import read_answer, read_request
from zenoh_cbef.protocol.messages import VERSION, BadMessage
from zenoh_cbef.protocol.questions import ADD, CLEAR, HOLD, LIST, STATUS, STOP, Question

QUESTIONS: dict[str, Question] = {one.name: one for one in (STOP, HOLD, ADD, CLEAR, LIST, STATUS)}
FAULT = {"kind": "loss", "number": 0, "from": 1.0, "until": None, "active": True}
TOLD = {
    "run": "mine",
    "filter": "sicf",
    "mode": "lockstep",
    "members": [0, 1],
    "silent": [],
    "away": [1],
    "dt": 0.1,
    "start": 5,
    "time": 6.5,
    "planar": False,
    "stopping": True,
    "estimates": [b"one"],
    "earlier": [],
    "cards": [],
    "events": [b"", b"x"],
    "agents": 3,
    "steps": 10,
    "step": None,
    "target": {"pid": 7},
    "live": ["agent/0"],
    "truth": [[1, [0.0, 1.0, float("nan"), 0.0, 0.0, 0.0]]],
    "faults": json.dumps([{"kind": "loss", "fault": 0}]),
}
ANSWERS: dict[str, dict] = {
    "stop": {"step": 4},
    "hold": {"held": True, "step": 4},
    "fault add": {"number": 1, "from": 2.5},
    "fault clear": {"ended": [0, 2]},
    "fault list": {"faults": json.dumps([FAULT, FAULT | {"until": 3}])},
    "status": TOLD,
}


def answer(asked, **fields):
    return read_answer(msgpack.packb(ANSWERS[asked] | fields), QUESTIONS[asked], "run/control")


@pytest.mark.parametrize("asked", ANSWERS)
def test_an_answer_is_what_was_promised_or_refused_with_the_name_of_the_field(asked):
    assert answer(asked).keys() == ANSWERS[asked].keys()
    for name in ANSWERS[asked]:
        lacking = {other: value for other, value in ANSWERS[asked].items() if other != name}
        with pytest.raises(UserError, match=rf"run/control answers with something else \({name} is not"):
            read_answer(msgpack.packb(lacking), QUESTIONS[asked], "run/control")


NO_NUMBER: list[object] = [True, "1", None, float("nan"), float("inf"), [1]]
NO_COUNT: list[object] = [True, "1", -1, 1.0, [1]]
WRONG: dict[tuple[str, str], list[object]] = {
    ("stop", "step"): NO_COUNT,
    ("hold", "held"): [None, 0, 1, "yes"],
    ("hold", "step"): NO_COUNT,
    ("hold", "round"): NO_COUNT,
    ("fault add", "number"): [*NO_COUNT, None],
    ("fault add", "from"): NO_NUMBER,
    ("fault clear", "ended"): [None, 1, [True], [-1], [None]],
    ("fault list", "faults"): [
        None,
        [],
        "{}",
        "[1]",
        "[",
        *(json.dumps([FAULT | {name: value}]) for name, value in {**FAULT, "kind": 1, "until": "x", "active": 1}.items()
          if value != FAULT[name]),
        json.dumps([FAULT, FAULT | {"from": True}]),
        json.dumps([FAULT, FAULT | {"number": None}]),
    ],
    ("status", "run"): [1, None],
    ("status", "members"): [[-1], None],
    ("status", "dt"): NO_NUMBER,
    ("status", "planar"): [0, 1, None, "yes"],
    ("status", "estimates"): [None, b"x", ["x"], [b""] * 10_001],
    ("status", "agents"): [*NO_COUNT, None, 10_001],
    ("status", "steps"): [*NO_COUNT, None],
    ("status", "step"): NO_COUNT,
    ("status", "target"): [None, [], 1],
    ("status", "live"): [None, [1], "agent/0"],
    ("status", "truth"): [
        None,
        [1],
        [[1]],
        [[1, [0.0] * 5]],
        [[1, [0.0] * 7]],
        [[-1, [0.0] * 6]],
        [[1, [0] * 6]],
        [[1, [1e101] * 6]],
        [[1, [0.0] * 6, 1]],
        [[1, (0.0,) * 5 + (float("-inf"),)]],
    ],
    ("status", "apart"): [
        None,
        "agent/0",
        ["agent/0"],
        [["agent/0", "agent/1"]],
        [["agent/0", "agent/1", True, True]],
        [["agent/0", "agent/1", 1]],
        [["agent/0", 1, True]],
        [[1, "agent/1", True]],
        [["agent/0", "agent/1", True], ["agent/0", "agent/2", None]],
        [("agent/0", "agent/1", True), {}],
    ],
    ("status", "faults"): [None, "[{}]", json.dumps([{"kind": "loss", "fault": -1}])],
}  # fmt: skip


@pytest.mark.parametrize(("asked", "name"), WRONG)
def test_a_field_of_another_kind_is_refused(asked, name):
    for value in WRONG[asked, name]:
        with pytest.raises(UserError, match=rf"\({name} is not|no number beyond|answers with something else"):
            answer(asked, **{name: value})


def test_the_largest_lists_and_counts_are_taken():
    assert len(answer("status", estimates=[b""] * 10_000)["estimates"]) == 10_000
    assert answer("status", agents=10_000)["agents"] == 10_000
    assert answer("stop", step=None)["step"] is None
    assert answer("status", truth=[[0, [1e100, -1e100] * 3]])["truth"] == [[0, [1e100, -1e100] * 3]]
    assert answer("fault list", faults="[]")["faults"] == "[]"
    for pairs in ([], [["agent/0", "agent/1", True], ["agent/0", "record/a", False]]):
        assert answer("status", apart=pairs)["apart"] == pairs
    for last in (None, 0, 7):
        assert answer("hold", round=last)["round"] == last
    assert answer("status", dt=1, time=True + 0.5)["dt"] == 1


def test_what_an_answer_may_lack_is_checked_where_it_is_there():
    for name in ("name", "unobservable"):
        assert answer("status", **{name: "x"})[name] == "x"
        with pytest.raises(UserError, match=rf"\({name} is not"):
            answer("status", **{name: 1})
    told = {"faults": json.dumps([{name: value for name, value in FAULT.items() if name != "until"}])}
    with pytest.raises(UserError, match=r"\(faults is not"):
        read_answer(msgpack.packb({"faults": json.dumps([{**FAULT, "until": "x"}])}), LIST, "run/control")
    assert read_answer(msgpack.packb(told), LIST, "run/control") == told


def test_the_sentence_of_a_refusal_is_the_users():
    with pytest.raises(UserError, match=r"^there is no fault 3$"):
        read_answer(msgpack.packb({"error": "there is no fault 3"}), CLEAR, "run/control")
    with pytest.raises(UserError, match="something else"):
        read_answer(b"\xc1", STOP, "run/control")


def test_a_request_has_a_version_and_asks_for_something():
    assert read_request(msgpack.packb({"v": VERSION, "ask": "stop"})) == {"v": VERSION, "ask": "stop"}
    for request, words in (
        ({"ask": "stop"}, "version None"),
        ({"v": VERSION + 1, "ask": "stop"}, f"version {VERSION + 1}"),
        ({"v": VERSION}, "asks for nothing"),
        ({"v": VERSION, "ask": 1}, "asks for nothing"),
    ):
        with pytest.raises(BadMessage, match=words):
            read_request(msgpack.packb(request))
