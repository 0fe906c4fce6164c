"""Requests to a run between real sessions: answered, refused with a sentence, or not answered at all."""

from __future__ import annotations

import math
from typing import Any

import msgpack
import pytest

from tests.protocol.conftest import Pair
from tests.waiting import until
from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.control import ask_control, serve_control
from zenoh_cbef.protocol.fields import field_of
from zenoh_cbef.protocol.log_service import _read
from zenoh_cbef.protocol.messages import BadMessage
from zenoh_cbef.protocol.questions import CLEAR, STOP, _Apart, _States, _Time
from zenoh_cbef.protocol.replay_service import serve_replay

KEY = "cbef/test/control"


def test_a_request_is_answered_or_refused_with_the_sentence_of_the_run(pair: Pair) -> None:
    asked: list[dict[str, Any]] = []

    def answer(request: dict[str, Any]) -> dict[str, Any]:
        asked.append(request)
        if request["ask"] == "fault clear":
            raise UserError("there is no fault 3")
        return {"step": 4}

    assert ask_control(pair[1], KEY, STOP, timeout=0.2) is None
    service = serve_control(pair[0], KEY, answer)
    until(lambda: ask_control(pair[1], KEY, STOP, timeout=1.0))
    assert asked[-1] == {"v": 1, "ask": "stop"}
    assert ask_control(pair[1], KEY, STOP, timeout=100.0, why="x") == {"step": 4}
    assert asked[-1] == {"v": 1, "ask": "stop", "why": "x"}
    with pytest.raises(UserError, match=r"^there is no fault 3$"):
        ask_control(pair[1], KEY, CLEAR, timeout=100.0)
    count = len(asked)
    for payload in (None, b"\xc1", msgpack.packb({"v": 1})):
        [reply] = pair[1].get(KEY, payload=payload, timeout=100.0)
        assert reply.ok is not None
        assert "error" in msgpack.unpackb(reply.ok.payload.to_bytes())
    assert len(asked) == count, "only what is a request is carried out"
    service.undeclare()


def test_a_replay_obeys_orders_in_their_order_and_tells_its_state(pair: Pair) -> None:
    obeyed: list[list[tuple[str, str]]] = []

    def obey(orders: list[tuple[str, str]]) -> dict[str, object]:
        if ("rate", "0") in orders:
            raise UserError("a rate is above 0")
        obeyed.append(orders)
        return {"time": 12.5}

    service = serve_replay(pair[0], "test", obey)
    until(lambda: list(pair[1].get("cbef/test/replay")))
    [reply] = pair[1].get("cbef/test/replay?seek=12.5;rate=2;pause", timeout=100.0)
    assert reply.ok is not None
    assert msgpack.unpackb(reply.ok.payload.to_bytes()) == {"v": 1, "run": "test", "time": 12.5}
    assert obeyed[-1] == [("seek", "12.5"), ("rate", "2"), ("pause", "")]
    assert obeyed[0] == []
    [reply] = pair[1].get("cbef/test/replay?rate=0", timeout=100.0)
    assert reply.err is not None
    assert reply.err.payload.to_string() == "a rate is above 0"
    service.undeclare()


@pytest.mark.parametrize("other", ["agent/1", "", 3, None, ["agent/1"]])
def test_two_that_have_no_link_are_told_by_their_names(other: object) -> None:
    status = field_of(_Apart)
    assert status.hold([[["agent/0", other, True]]]) == isinstance(other, str)
    assert status.hold([[[other, "agent/0", True]]]) == isinstance(other, str)
    assert not status.hold([[["agent/0", "agent/1", 1]]])


def test_of_several_values_each_is_looked_at() -> None:
    seconds, states, there = field_of(_Time), field_of(_States), [0.5] * 6
    assert seconds.hold([1.0, 2])
    assert states.hold([[[1, there], [2, there]]])
    for wrong in (math.nan, True, "1"):
        assert not seconds.hold([1.0, wrong])
    for odd in ([2, there[1:]], [2, [*there[1:], "x"]], [-2, there], [2, there, 3], 2):
        assert not states.hold([[[1, there], odd]])


@pytest.mark.parametrize(
    "changed", [{"names": ["a", 2]}, {"digests": [b"", "b"]}, {"sizes": [1, -2]}, {"sizes": [1]}, {"names": ["a"]}]
)
def test_an_offer_of_logs_has_a_name_a_size_and_a_digest_of_each(changed: dict[str, Any]) -> None:
    whole = {"v": 1, "names": ["a", "b"], "sizes": [1, 2], "digests": ["0", "1"]}
    assert _read("record", msgpack.packb(whole)).names == ("a", "b")
    with pytest.raises(BadMessage):
        _read("record", msgpack.packb(whole | changed))
