"""Nothing that others send stops a reader: what is nested, endless, absurd or a lie is refused in a few words."""

from __future__ import annotations

import contextlib
import math

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.log.hand_made import KEYS, RUN, Maker
from tests.log.made import made_log
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.log.tools.check import check
from zenoh_cbef.nodes.common.recording import Status
from zenoh_cbef.nodes.recorder.overview import Overview
from zenoh_cbef.plain import DEEPEST, count_in, counts_in, flaw, read_json, read_toml, whole
from zenoh_cbef.protocol.control import read_answer, read_request
from zenoh_cbef.protocol.kinds import EVENT
from zenoh_cbef.protocol.messages import BadMessage, decode, encode
from zenoh_cbef.protocol.questions import ADD, CLEAR, LIST, STATUS, STOP, Question
from zenoh_cbef.protocol.scenario_service import Clock, read_scenario
from zenoh_cbef.scenario.injected import read_tables

PLAIN = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(-(1 << 63), (1 << 64) - 1), st.floats(), st.text(max_size=5)),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=5), inner, max_size=4)),
    max_leaves=20,
)
TABLES = st.dictionaries(st.sampled_from(["sent", "step", "word", "total", "rejected", "planned", "agent"]), PLAIN)


def nested(levels):
    value: object = 1
    for _ in range(levels):
        value = [value]
    return value


@settings(max_examples=60, deadline=None)
@given(TABLES)
def test_an_event_with_any_data_is_refused_or_read_by_all_who_take_something_from_it(data):
    message = encode(RUN, "agent/0", 0, 1, {"kind": "finished", "text": "", "data": data})
    try:
        event = decode(EVENT, message, run=RUN)
    except BadMessage:
        assert flaw(data)
        return
    assert all(type(count) is int and count >= 0 for count in counts_in(event["data"], "sent").values())
    step = count_in(event["data"], "step")
    assert step is None or (type(step) is int and step >= 0)


@pytest.mark.parametrize(
    "data",
    [
        nested(DEEPEST + 1),
        nested(400),
        float("nan"),
        msgpack.Timestamp(1),
        msgpack.ExtType(5, b"abc"),
        b"bytes",
        {b"name": 1},
    ],
)
def test_an_event_that_is_not_plain_is_refused(data):
    message = msgpack.packb(
        {"v": 1, "run": RUN, "from": "a", "seq": 0, "sent": 0, "kind": "", "text": "", "data": {"x": data}}
    )
    with pytest.raises(BadMessage):
        decode(EVENT, message, run=RUN)


def test_lists_that_claim_to_be_long_take_no_room():
    with pytest.raises(BadMessage, match="not msgpack"):
        decode(EVENT, b"\x81\xa1x" + b"\xdd\x00\x0f\xff\xff" * 1000 + bytes(1 << 19), run=RUN)


@pytest.mark.parametrize("text", ["\x1b[2J", "\x00", "a\x07"])
def test_a_text_cannot_command_a_terminal(text):
    with pytest.raises(BadMessage):
        decode(EVENT, encode(RUN, "a", 0, 0, {"kind": "x", "text": text}), run=RUN)


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"a":' * 5000, "9" * 5000, "NaN", "1e999", '"\\ud800"', " " * (1 << 21), nested(40)]
)
def test_json_has_limits(text):
    with pytest.raises(ValueError, match=r"it (nests|holds|is longer)|digits|Expecting"):
        read_json(str(text))
    with pytest.raises(UserError, match="injected faults"):
        read_tables(str(text))


@pytest.mark.parametrize("text", ["a." * 500_000 + "a=1", "x=" + "[" * 5000, "x=" + "{a=" * 3000, "x=" + "9" * 5000])
def test_toml_has_limits(text):
    with pytest.raises(ValueError, match=r"it nests|digits"):
        read_toml(text)
    reply = {"v": 1, "run": RUN, "source": "", "resolved": text, "program": "1", "step": [], "agents": [-1]}
    assert read_scenario(msgpack.packb(reply), RUN).agents == ()


@given(st.one_of(st.text(max_size=8), st.integers().map(str), st.just("9" * 5000)))
def test_whole_numbers_are_read_without_a_crash(text):
    found = whole(text)
    assert found is None or (text.isascii() and int(text) == found)


QUESTIONS: tuple[Question, ...] = (STATUS, LIST, ADD, CLEAR, STOP)


@settings(max_examples=40, deadline=None)
@given(st.dictionaries(st.sampled_from(["v", "ask", "fault", "x"]), PLAIN), st.binary(max_size=40))
def test_requests_and_answers_are_taken_or_refused(table, raw):
    for data in (msgpack.packb(table), raw):
        with contextlib.suppress(BadMessage):
            assert isinstance(read_request(data)["ask"], str)
        for question in QUESTIONS:
            with pytest.raises(UserError):
                read_answer(data, question, "cbef/run/control")


def test_a_forged_estimate_far_away_does_not_stop_a_recorder():
    overview = Overview(Status(RUN, "", 50), lambda: 1)
    counts: dict[str, list] = {name: [] for name in ("neighbours", "received", "lost", "late", "latency")}
    far = {"k": 1, "state": [1e99] * 6, "innovation": None, "weight": None, **counts, "covariance": None}
    overview.see("truth", KEYS.truth, [encode(RUN, "target", 0, 0, {"k": 1, "state": [-1e99] * 6})])
    overview.see("estimate", KEYS.estimate(0), [encode(RUN, "agent/0", 0, 0, far)])
    overview.catch_up()
    assert overview.status.step == 1


def test_the_error_is_that_of_honest_agents_in_the_plane_that_is_tracked():
    counts: dict[str, list] = {name: [] for name in ("neighbours", "received", "lost", "late", "latency")}
    plain = {"k": 1, "innovation": None, "weight": None, **counts, "covariance": None}
    for left_out, axes, error in (((), 3, math.sqrt(53.0)), ({1}, 3, 5.0), ({1}, 2, 3.0), ({0, 1}, 3, None)):
        overview = Overview(Status(RUN, "", 50), lambda: 2, left_out, axes)
        overview.see("truth", KEYS.truth, [encode(RUN, "target", 0, 0, {"k": 1, "state": [0.0] * 6})])
        for agent, x, z in ((0, 3.0, 4.0), (1, 9.0, 0.0)):
            said = {"state": [x, 0.0, z, 0.0, 0.0, 0.0], **plain}
            overview.see("estimate", KEYS.estimate(agent), [encode(RUN, f"agent/{agent}", 0, 0, said)])
        overview.catch_up()
        assert (overview.status.step, overview.status.error) == (1, error)


def test_a_message_that_is_none_spoils_no_others_that_wait_with_it():
    overview = Overview(Status(RUN, "", 50), lambda: 1)
    counts: dict[str, list] = {name: [] for name in ("neighbours", "received", "lost", "late", "latency")}
    plain = {"state": [0.0] * 6, "innovation": None, "weight": None, **counts, "covariance": None}
    first, second = (encode(RUN, "agent/0", step, 0, {"k": step, **plain}) for step in (1, 2))
    lacking = encode(RUN, "agent/0", 2, 0, {"k": 3, "state": [0.0] * 6})
    overview.see("truth", KEYS.truth, [encode(RUN, "target", 0, 0, {"k": 1, "state": [3.0, 4.0, 0.0] * 2})])
    overview.see("estimate", KEYS.estimate(0), [first, b"none", lacking])
    assert not overview.heard, "they wait"
    overview.catch_up()
    assert (overview.status.step, overview.status.error) == (1, 5.0)
    assert overview.heard == {0: 1}, "the one of step 3 lacks fields"
    overview.see("estimate", KEYS.estimate(1), [second])
    overview.see("estimate", KEYS.estimate(0), [second] * 4000)
    assert overview.heard == {0: 2}, "no more wait than that, and no message is another agent's"


def test_a_recorder_tells_how_far_agents_are_that_a_target_has_left_behind():
    overview = Overview(Status(RUN, "", 2000), lambda: 2)
    counts: dict[str, list] = {name: [] for name in ("neighbours", "received", "lost", "late", "latency")}

    def truth(step):
        overview.see("truth", KEYS.truth, [encode(RUN, "target", step, 0, {"k": step, "state": [0.0] * 6})])

    def estimate(agent, step):
        said = {"k": step, "state": [1.0] * 6, "innovation": None, "weight": None, **counts, "covariance": None}
        overview.see("estimate", KEYS.estimate(agent), [encode(RUN, f"agent/{agent}", step, 0, said)])
        overview.catch_up()

    for step in range(1, 1001):
        truth(step)
    estimate(0, 3)
    assert (overview.status.step, overview.status.error) == (0, None)
    estimate(1, 2)
    assert (overview.status.step, overview.status.error) == (2, None)
    estimate(0, 1000)
    estimate(1, 1000)
    assert overview.status.step == 1000
    assert overview.status.error == pytest.approx(3.0**0.5)
    estimate(0, 900)
    assert overview.status.error is not None


def test_a_log_with_messages_on_any_key_is_read_by_every_verb(tmp_path):
    made = Maker(tmp_path / "run.mcap")
    for number in range(3000):
        made.log.add(f"cbef/{RUN}/agent/{number}/{'9' * 10}", b"\x80", made.now)
    for key in (f"cbef/{RUN}/agent/{'9' * 5000}/round", f"cbef/{RUN}/agent/{'9' * 900}/round", "x/" + "y" * 70_000):
        made.log.add(key, b"\x80", made.now)
    made.step(1)
    made.send(KEYS.estimate(0), "agent/0", k=1 << 62, state=[0.0] * 6)
    made.close()
    assert made.log.foreign >= 2000
    wrong = check(open_log(tmp_path / "run.mcap")).wrong
    assert wrong["others"] > 800
    assert read_trace(tmp_path / "run.mcap").estimates.shape[1] == 1
    assert verify(tmp_path / "run.mcap").exit_status in {1, 2}


def test_a_sound_log_to_its_end_is_sound(tmp_path):
    # The signal that ends a run is numbered one past its last step.
    assert check(open_log(made_log(tmp_path / "run.mcap", "steps=5"))).exit_status == 0


@pytest.mark.parametrize(("ahead", "ours"), [(3600.0, 3700.0), (-3600.0, -3500.0), (0.9, 100.0)])
def test_a_moment_is_told_on_our_clock_where_the_clocks_are_far_apart(ahead, ours):
    assert Clock(ahead, 0.01).ours(100.0) == ours
