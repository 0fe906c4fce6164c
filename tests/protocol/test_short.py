"""Consensus messages of few bytes: read as they were written, by none but their readers, and never beyond the run."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from zenoh_cbef.protocol.keys import address
from zenoh_cbef.protocol.messages import BadMessage, unpack
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.protocol.short import (
    HEAD_BYTES,
    SILENCE,
    SILENT_BYTES,
    ShortCodec,
    framed,
    is_short,
    numbered,
    packed,
    step_of,
)
from zenoh_cbef.tracking.compact import Compact

COMPACT = Compact(14, (4,), "int12")
CODEC = ShortCodec(COMPACT)
AT = address("cbef/run/agent/3/round")
NUMBERS = st.tuples(
    st.integers(0, 2**32 - 1), st.integers(0, 2**63 - 1), st.integers(0, 2**32 - 1), st.integers(0, 10_000)
)


@given(NUMBERS, st.lists(st.floats(-1e30, 1e30), min_size=14, max_size=14))
@examples(100)
def test_a_message_is_read_as_it_was_written_alone_and_among_others(numbers, values):
    payload = COMPACT.rounded(np.array([values]))
    seq, sent, step, round_ = numbers
    data = CODEC.encode(seq, sent, step, round_, payload)
    assert CODEC.decode(data) == (step, round_, sent, payload.tobytes())
    many = CODEC.decode_all([data, CODEC.encode(0, 1, 2, 3, np.zeros(14)), data])
    assert many.payload[2].tobytes() == payload.tobytes()
    assert (many.seq[2], many.sent[2], many.step[2], many.round[2]) == numbers
    assert is_short(data, AT)
    assert (*numbered(data), step_of(data)) == (seq, sent, step)


def test_silence_has_no_payload_and_is_refused_where_agents_always_speak():
    quiet = ShortCodec(Compact(14, (4,), "int12", silences=True))
    payload = COMPACT.rounded(np.linspace(1.0, 2.0, 14)[None])
    silence, told = quiet.encode(7, 8, 9, 3, np.full(14, np.nan)), quiet.encode(8, 9, 9, 4, payload)
    assert len(silence) == SILENT_BYTES
    assert is_short(silence, AT)
    assert (*numbered(silence), step_of(silence)) == (7, 8, 9)
    many = quiet.decode_all([silence, told, silence])
    assert many.round.tolist() == [3, 4, 3]
    assert np.isnan(many.payload[[0, 2]]).all()
    assert many.payload[1].tobytes() == payload.tobytes()
    with pytest.raises(BadMessage, match="silence, which the run does not have"):
        CODEC.decode(silence)


def test_messages_that_are_packed_together_are_those_of_senders_on_their_own():
    codec = ShortCodec(compact := Compact(14, (4,), "int12", silences=True))
    random = np.random.default_rng(1)
    # Integers, floats where the matrix is not positive, a state that is far off, and silence.
    payloads = np.concatenate([random.normal(size=(6, 4)), np.zeros((6, 10))], axis=1)
    payloads[:, [4, 8, 11, 13]] = [[1.0], [-1.0], [1.0], [2.0], [1.0], [3.0]]
    payloads[2, :4] *= 1e5
    payloads = compact.rounded(payloads)
    payloads[3] = np.nan
    said = packed(compact, payloads)
    assert len({one[0] for one in said}) == 4
    alone = [codec.encode(row, 5, 6, 7, payload) for row, payload in enumerate(payloads)]
    assert [framed(row, 5, 6, 7, one) for row, one in enumerate(said)] == alone
    assert packed(compact, payloads[[3, 3]]) == [SILENCE] * 2


@given(st.binary(max_size=200))
@examples(200)
def test_hostile_bytes_are_refused(data):
    try:
        _, _, _, payload = CODEC.decode(data)
    except BadMessage:
        return
    assert np.isfinite(np.frombuffer(payload)).all()


def test_neither_kind_of_message_is_taken_for_the_other():
    short = CODEC.encode(0, 1, 2, 3, np.zeros(14))
    long = RoundCodec("run", "agent/3", 14).encode(0, 1, 2, 3, np.zeros(14))
    with pytest.raises(BadMessage):
        unpack(short)
    with pytest.raises(BadMessage):
        CODEC.decode(long)
    assert not is_short(long, AT)
    assert not is_short(short, address("cbef/run/agent/3/estimate"))
    damaged = bytes(byte ^ 0xFF for byte in short[:8]) + short[8:]
    with pytest.raises(BadMessage):
        CODEC.decode(damaged)


def test_a_message_of_a_plane_is_a_fraction_of_one_in_all_bits():
    # x, 4 rows: 28 bytes of integers with the code, and the head.
    assert HEAD_BYTES + COMPACT.size == 46
    assert len(RoundCodec("run", "agent/3", 14).encode(0, 1, 2, 3, np.zeros(14))) == 187


def test_what_one_message_of_many_has_wrong_refuses_all() -> None:
    quiet = ShortCodec(Compact(14, (4,), "int12", silences=True))
    sound, silence = quiet.encode(1, 2, 3, 4, np.zeros(14)), quiet.encode(1, 2, 3, 4, np.full(14, np.nan))
    late = framed(1, 1 << 63, 3, 4, SILENCE)
    assert quiet.decode_all([framed(1, (1 << 63) - 1, 3, 4, SILENCE)]).sent.tolist() == [(1 << 63) - 1]
    for wrong, words in ((late, "field sent is not as promised"), (sound[: SILENT_BYTES - 1], "too short")):
        for messages in ([wrong], [sound, wrong], [wrong, silence]):
            with pytest.raises(BadMessage, match=words):
                quiet.decode_all(messages)
    with pytest.raises(BadMessage, match="silence, which the run does not have"):
        CODEC.decode_all([sound, silence])
    assert not is_short(silence[:-1], AT)
    assert not is_short(b"\2" + silence[1:], AT)
    assert not is_short(silence, None)


def test_numbers_of_a_message_go_round_after_32_bits() -> None:
    assert numbered(framed((1 << 32) + 5, 9, 3, 4, SILENCE)) == (5, 9)
    assert numbered(framed((1 << 32) - 1, 9, 3, 4, SILENCE)) == ((1 << 32) - 1, 9)
