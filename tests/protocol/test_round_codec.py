"""The fast codec writes standard messages and accepts what the general decoder accepts."""

from __future__ import annotations

import math

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from zenoh_cbef.protocol.kinds import ROUND
from zenoh_cbef.protocol.messages import VERSION, BadMessage, decode, encode, pack_floats
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.tracking.moderation import LARGEST_SENT

RUN, SENDER = "run-1", "agent/3"
WIDTHS = st.sampled_from([1, 4, 14, 27])
FLOATS = st.floats(-LARGEST_SENT, LARGEST_SENT)


@st.composite
def messages(draw):
    """Numbers of a round message, in the ranges that a run can reach."""
    width = draw(WIDTHS)
    payload = np.array(draw(st.lists(FLOATS, min_size=width, max_size=width)))
    numbers = [draw(st.integers(0, most)) for most in (2**63 - 1, 2**63 - 1, 2**32 - 1, 2**16 - 1)]
    return width, numbers, payload


def general(data, width):
    """What the general decoder makes of it, of a payload that long; None where it refuses."""
    try:
        message = decode(ROUND, data, run=RUN, sender=SENDER)
    except BadMessage:
        return None
    if len(message["payload"]) != 8 * width or message["k"] >= 2**32:
        return None
    return message["k"], message["l"], message["sent"], message["payload"]


def fast(data, width):
    try:
        step, round_, sent, payload = RoundCodec(RUN, SENDER, width).decode(data)
    except BadMessage:
        return None
    if not (np.abs(np.frombuffer(payload)) <= LARGEST_SENT).all():  # as the agent looks at it
        return None
    return step, round_, sent, pack_floats(np.frombuffer(payload))


@settings(deadline=None)
@given(messages())
def test_what_it_writes_is_a_standard_message(message):
    width, (seq, sent, step, round_), payload = message
    data = RoundCodec(RUN, SENDER, width).encode(seq, sent, step, round_, payload)
    assert type(data) is bytes
    fields = {"v": VERSION, "run": RUN, "from": SENDER, "seq": seq, "sent": sent, "k": step, "l": round_}
    assert msgpack.unpackb(data) == {**fields, "payload": pack_floats(payload)}
    assert list(msgpack.unpackb(data)) == [*fields, "payload"]
    assert decode(ROUND, data, run=RUN, sender=SENDER)["payload"] == pack_floats(payload)


@settings(deadline=None)
@given(messages())
def test_what_it_writes_it_reads_back(message):
    width, (seq, sent, step, round_), payload = message
    codec = RoundCodec(RUN, SENDER, width)
    read = codec.decode(codec.encode(seq, sent, step, round_, payload))
    assert read[:3] == (step, round_, sent)
    assert read[3] == payload.tobytes()


@settings(deadline=None)
@given(messages())
def test_it_reads_what_any_msgpack_writer_makes_of_the_same_message(message):
    width, (seq, sent, step, round_), payload = message
    body = {"k": step, "l": round_, "payload": pack_floats(payload)}
    plain = encode(RUN, SENDER, seq, sent, body)
    turned = msgpack.packb(dict(reversed(msgpack.unpackb(plain).items())))
    for data in (plain, turned):
        read = RoundCodec(RUN, SENDER, width).decode(data)
        assert read[:3] == (step, round_, sent)
        assert read[3] == payload.tobytes()


@examples(150)
@given(messages(), st.data())
def test_it_accepts_exactly_what_the_general_decoder_accepts(message, data):
    width, (seq, sent, step, round_), payload = message
    if data.draw(st.booleans()):
        mutated = bytearray(RoundCodec(RUN, SENDER, width).encode(seq, sent, step, round_, payload))
    else:
        mutated = bytearray(encode(RUN, SENDER, seq, sent, {"k": step, "l": round_, "payload": pack_floats(payload)}))
    for _ in range(data.draw(st.integers(0, 4))):
        mutated[data.draw(st.integers(0, len(mutated) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    if data.draw(st.integers(0, 4)) == 0:
        mutated = mutated[: data.draw(st.integers(0, len(mutated)))]
    assert fast(bytes(mutated), width) == general(bytes(mutated), width)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 2 * LARGEST_SENT])
def test_size_is_left_to_the_caller_only_in_messages_of_the_fixed_layout(value):
    codec = RoundCodec(RUN, SENDER, 2)
    *_, payload = codec.decode(codec.encode(0, 1, 2, 3, np.array([1.0, value])))
    assert not abs(np.frombuffer(payload)[1]) <= LARGEST_SENT
    loose = encode(RUN, SENDER, 0, 1, {"k": 2, "l": 3, "payload": pack_floats(np.array([1.0, value]))})
    with pytest.raises(BadMessage):
        codec.decode(loose)


@pytest.mark.parametrize(
    "data",
    [
        RoundCodec("other", SENDER, 3).encode(0, 1, 2, 3, np.ones(3)),
        RoundCodec(RUN, "agent/4", 3).encode(0, 1, 2, 3, np.ones(3)),
        RoundCodec(RUN, SENDER, 2).encode(0, 1, 2, 3, np.ones(2)),
        RoundCodec(RUN, SENDER, 3).encode(0, 1, 2, 3, np.ones(3)) + b"\0",
        encode(RUN, SENDER, 0, 1, {"k": 2**63, "l": 1, "payload": bytes(24)}),
        b"",
    ],
)
def test_messages_of_others_and_of_other_sizes_are_refused(data):
    with pytest.raises(BadMessage):
        RoundCodec(RUN, SENDER, 3).decode(data)


@pytest.mark.parametrize("run", ["r", "x" * 31, "x" * 32, "é" * 40, "x" * 300])
def test_names_of_any_length_fit(run):
    codec = RoundCodec(run, SENDER, 1)
    data = codec.encode(1, 2, 3, 4, np.array([5.0]))
    assert decode(ROUND, data, run=run, sender=SENDER)["k"] == 3
    assert codec.decode(data)[:3] == (3, 4, 2)


@pytest.mark.parametrize("numbers", [(0, 0, 0, 0), (2**63 - 1, 2**63 - 1, 2**32 - 1, 2**16 - 1)])
def test_numbers_of_all_bits_need_no_general_decoder(
    monkeypatch: pytest.MonkeyPatch, numbers: tuple[int, int, int, int]
) -> None:
    monkeypatch.setattr("zenoh_cbef.protocol.round_codec.decode", None)
    codec, payload = RoundCodec(RUN, SENDER, 4), np.array([LARGEST_SENT, -LARGEST_SENT, 0.0, 1.0])
    seq, sent, step, round_ = numbers
    data = codec.encode(seq, sent, step, round_, payload)
    assert codec.decode(data) == (step, round_, sent, payload.tobytes())
    many = codec.decode_all([data, data])
    assert [many.seq[1], many.sent[1], many.step[1], many.round[1]] == [seq, sent, step, round_]
    assert many.payload[1].tobytes() == payload.tobytes()
