"""Many messages read at once are those that each is alone, and one that is not as promised refuses all of them."""

from __future__ import annotations

from typing import Any

import msgpack
import numpy as np
import pytest

from zenoh_cbef.protocol import kinds, round_codec
from zenoh_cbef.protocol.messages import (
    LARGEST,
    VERSION,
    BadMessage,
    decode,
    decode_all,
    encode,
    json_schema,
    pack_floats,
    peek,
    unpack,
)
from zenoh_cbef.protocol.round_codec import RoundCodec

RUN, SENDER = "run-1", "agent/3"
EVENT = {"v": VERSION, "run": RUN, "from": SENDER, "seq": 0, "sent": 1, "kind": "joined", "text": "x"}


def events(*changes: dict[str, Any], without: str = "") -> list[bytes]:
    tables = [{**EVENT, **change} for change in changes]
    tables[-1].pop(without, None)
    return [msgpack.packb(table) for table in tables]


def test_all_are_read_in_their_order_though_some_lack_what_they_may_lack() -> None:
    several = events({"seq": 1}, {"seq": 2, "data": {"step": 4}}, {"seq": 3})
    assert decode_all(kinds.EVENT, several, run=RUN, sender=SENDER) == [
        decode(kinds.EVENT, one, run=RUN) for one in several
    ]
    assert decode_all(kinds.EVENT, [], run=RUN) == []
    mixed = events({}, {"from": "agent/4"})
    assert [one["from"] for one in decode_all(kinds.EVENT, mixed, run=RUN)] == [SENDER, "agent/4"]


@pytest.mark.parametrize(
    ("change", "without", "said"),
    [
        ({}, "text", "a field is missing"),
        ({"bogus": 1}, "", "field 'bogus' is not as promised"),
        ({"seq": -1}, "", "field 'seq' is not as promised"),
        ({"data": 1}, "", "field 'data' is not as promised"),
        ({"run": "other"}, "", "of run 'other'"),
        ({"v": 2}, "", "version 2, not 1"),
        ({"from": "agent/4"}, "", "from 'agent/4', not agent/3"),
    ],
)
def test_one_that_is_not_as_promised_refuses_all(change: dict[str, Any], without: str, said: str) -> None:
    for several in (events({}, {}, change, without=without), events({}, change, without=without)[::-1]):
        with pytest.raises(BadMessage, match=said):
            decode_all(kinds.EVENT, several, run=RUN, sender=SENDER)


def test_the_field_that_is_missing_is_named() -> None:
    with pytest.raises(BadMessage, match=r"^field kind is missing$"):
        decode(kinds.EVENT, msgpack.packb({name: EVENT[name] for name in ("v", "run", "from", "seq", "sent")}), run=RUN)


def test_a_glance_at_a_step_needs_all_fields_but_no_more_of_them() -> None:
    message = {**EVENT, "k": 5, "position": "anywhere", "range": None}
    assert peek(kinds.RANGE, msgpack.packb(message), run=RUN, sender=SENDER) == 5
    del message["range"]
    with pytest.raises(BadMessage, match="missing"):
        peek(kinds.RANGE, msgpack.packb(message), run=RUN, sender=SENDER)
    for step in (True, 1 << 63, -1):
        with pytest.raises(BadMessage, match="field k"):
            peek(kinds.RANGE, msgpack.packb({**message, "range": None, "k": step}), run=RUN, sender=SENDER)


def test_the_largest_message_is_read_and_extensions_are_not() -> None:
    empty = len(msgpack.packb({"x": bytes(1 << 16)})) - (1 << 16)
    assert len(unpack(msgpack.packb({"x": bytes(LARGEST - empty)}))) == 1
    assert LARGEST == 1 << 20
    with pytest.raises(BadMessage, match="larger than 1048576 bytes"):
        unpack(bytes(LARGEST + 1))
    for extension in (b"a", b"abc"):
        with pytest.raises(BadMessage, match="not msgpack"):
            unpack(msgpack.packb({"x": msgpack.ExtType(5, extension)}))
    with pytest.raises(BadMessage, match="not a map"):
        unpack(msgpack.packb([]))


def test_a_list_or_table_of_as_many_items_as_are_allowed_is_read() -> None:
    for value in ([0] * 10_000, {str(n): n for n in range(10_000)}):
        assert unpack(msgpack.packb({"x": value})) == {"x": value}
    for value in ([0] * 10_001, {str(n): n for n in range(10_001)}):
        with pytest.raises(BadMessage, match="not msgpack"):
            unpack(msgpack.packb({"x": value}))


def test_a_schema_tells_other_languages_what_is_checked() -> None:
    count = {"type": "integer", "minimum": 0}
    number_or_nil = {"type": ["number", "null"]}
    doubles = {"type": "string", "contentEncoding": "binary", "description": "little-endian float64"}

    def numbers(size: int) -> dict[str, Any]:
        return {"type": "array", "items": {"type": "number"}, "minItems": size, "maxItems": size}

    signal, range_, estimate, smoothed = (
        json_schema(kinds.MESSAGE_KINDS[name]) for name in ("signal", "range", "estimate", "smoothed")
    )
    assert (signal["title"], signal["type"]) == ("cbef.Signal", "object")
    assert signal["required"] == ["from", "k", "run", "sent", "seq", "signal", "v"]
    assert signal["properties"]["k"] == signal["properties"]["seq"] == smoothed["properties"]["until"] == count
    assert signal["properties"]["at"] == {"type": "number", "minimum": 0, "exclusiveMaximum": 1e10}
    assert signal["properties"]["signal"] == {"enum": ["start", "end", "round"]}
    assert (range_["properties"]["position"], estimate["properties"]["state"]) == (numbers(3), numbers(6))
    assert range_["properties"]["range"] == number_or_nil
    assert estimate["properties"]["neighbours"] == {"type": "array", "items": count}
    assert estimate["properties"]["latency"] == {"type": "array", "items": number_or_nil}
    assert smoothed["properties"]["covariance"] == doubles
    assert estimate["properties"]["covariance"] == {**doubles, "type": ["string", "null"]}


CODEC = RoundCodec(RUN, SENDER, 2)
PAYLOADS = np.array([[1.0, -2.0], [3.0, 4.0], [5.0, 1e60]])


def rounds(codec: RoundCodec = CODEC) -> list[bytes]:
    return [codec.encode(10 + n, 100 + n, 20 + n, n, payload) for n, payload in enumerate(PAYLOADS)]


def test_rounds_of_the_fixed_layout_and_of_any_other_are_read_alike() -> None:
    bodies = [{"k": 20 + n, "l": n, "payload": pack_floats(payload)} for n, payload in enumerate(PAYLOADS)]
    loose = [encode(RUN, SENDER, 10 + n, 100 + n, body) for n, body in enumerate(bodies)]
    for several in (rounds(), loose, [*rounds()[:2], loose[2]]):
        found = CODEC.decode_all(several)
        assert (found.seq.tolist(), found.sent.tolist()) == ([10, 11, 12], [100, 101, 102])
        assert (found.step.tolist(), found.round.tolist()) == ([20, 21, 22], [0, 1, 2])
        assert found.payload.tobytes() == PAYLOADS.tobytes()


@pytest.mark.parametrize(
    "other",
    [
        RoundCodec("run-2", SENDER, 2).encode(0, 1, 2, 3, PAYLOADS[0]),
        RoundCodec(RUN, "agent/4", 2).encode(0, 1, 2, 3, PAYLOADS[0]),
        RoundCodec(RUN, SENDER, 1).encode(0, 1, 2, 3, PAYLOADS[0, :1]),
        CODEC.encode(0, 1, 2, 3, np.array([np.nan, 0.0])),
        CODEC.encode(0, 1, 2, 3, np.array([0.0, 1.1e60])),
        CODEC.encode(0, 1 << 63, 2, 3, PAYLOADS[0]),
        CODEC.encode(1 << 63, 1, 2, 3, PAYLOADS[0]),
        b"",
    ],
)
def test_one_round_that_is_not_as_promised_refuses_all(other: bytes) -> None:
    for several in ([*rounds(), other], [other, *rounds()]):
        with pytest.raises(BadMessage):
            CODEC.decode_all(several)


def test_a_host_whose_bytes_are_in_the_other_order_sends_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    sent = rounds()
    monkeypatch.setattr(round_codec, "_LITTLE", False)
    assert rounds() == sent
    assert [CODEC.decode(data)[3] for data in sent] == [payload.tobytes() for payload in PAYLOADS]


def test_a_caller_who_reads_some_fields_asks_for_these_alone() -> None:
    several = events({"seq": 1, "data": 5}, {"bogus": 2})
    assert [one["text"] for one in decode_all(kinds.EVENT, several, run=RUN, names=["text"])] == ["x", "x"]
    with pytest.raises(BadMessage, match="data"):
        decode_all(kinds.EVENT, several, run=RUN, names=["text", "data"])
    with pytest.raises(BadMessage, match="missing"):
        decode_all(kinds.EVENT, events({}, without="kind"), run=RUN, names=["text"])
    with pytest.raises(BadMessage, match="of run"):
        decode_all(kinds.EVENT, events({"run": "other"}), run=RUN, names=["text"])
