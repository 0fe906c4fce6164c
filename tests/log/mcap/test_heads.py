"""A part of a file that is sound is read by columns, any other message by message, and both give the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.log.mcap import heads
from zenoh_cbef.log.mcap.contents import (
    MAX_RECORD_BYTES,
    MESSAGE,
    RECORD,
    Channel,
    Declarations,
    RawMessage,
    Record,
    messages_in,
)
from zenoh_cbef.log.mcap.heads import Batch, gathered, heads_in

CHANNEL = Channel(1, "a", "", "", "", b"", {})
WHOLE = RECORD.pack(5, MESSAGE.size + 1) + MESSAGE.pack(1, 7, 8, 9) + b"x"
EMPTY = RECORD.pack(5, MESSAGE.size) + MESSAGE.pack(1, 2, 3, 4)
SHORT = RECORD.pack(5, MESSAGE.size - 1) + MESSAGE.pack(1, 0, 0, 0)[:-1]
THIRD = RECORD.pack(5, MESSAGE.size) + MESSAGE.pack(3, 2, 3, 4)
STRANGE = RECORD.pack(5, MESSAGE.size) + MESSAGE.pack(2, 0, 0, 0)
OTHER = RECORD.pack(0x80, 0)


def declarations() -> Declarations:
    known = Declarations()
    # Of which one or both have a message here.
    known.channels.update({1: CHANNEL, 3: replace(CHANNEL, id=3)})
    return known


def by_columns(data: bytes) -> tuple[list[RawMessage], list[str]]:
    told: list[str] = []
    return heads_in(data, Record(0, 0, len(data)), declarations(), told.append).messages(), told


def one_by_one(data: bytes) -> tuple[list[RawMessage], list[str]]:
    told: list[str] = []
    return list(messages_in(data, Record(0, 0, len(data)), declarations(), told.append)), told


@pytest.mark.parametrize(
    "data", [WHOLE, EMPTY, WHOLE + EMPTY, EMPTY + OTHER, OTHER + WHOLE + WHOLE, OTHER * 5, WHOLE + THIRD], ids=len
)
def test_a_sound_part_is_read_at_once(monkeypatch: pytest.MonkeyPatch, data: bytes) -> None:
    expected = one_by_one(data)
    monkeypatch.setattr(heads, "messages_in", None)
    assert by_columns(data) == expected


@pytest.mark.parametrize(
    "data",
    [
        b"",
        SHORT + WHOLE,
        WHOLE + SHORT,
        WHOLE + WHOLE[:-1],
        WHOLE + EMPTY[:12],
        WHOLE + STRANGE,
        WHOLE + RECORD.pack(5, MAX_RECORD_BYTES + 1) + MESSAGE.pack(1, 0, 0, 0),
        WHOLE + RECORD.pack(5, 2) + b"ab",
    ],
    ids=len,
)
def test_a_part_that_is_not_sound_is_read_message_by_message(data: bytes) -> None:
    assert by_columns(data) == one_by_one(data)


def batch(*contents: bytes, channels: dict[int, Channel]) -> Batch:
    return Batch.of([RawMessage(CHANNEL, 1, 2, 3, one) for one in contents], channels)


def test_batches_of_the_same_channels_are_joined_up_to_a_size(monkeypatch: pytest.MonkeyPatch) -> None:
    known, others = {1: CHANNEL}, {1: CHANNEL}
    parts = [batch(b"ab", channels=known), batch(b"c", b"d", channels=known), batch(b"efg", channels=others)]
    joined = list(gathered(parts))
    assert [one.contents(np.arange(len(one))) for one in joined] == [[b"ab", b"c", b"d"], [b"efg"]]
    assert [one.chunk.tolist() for one in joined] == [[0, 1, 1], [0]]
    assert joined[1] is parts[2]
    monkeypatch.setattr(heads, "_AT_ONCE", 2)
    assert len(list(gathered(parts))) == 3
    assert list(gathered([])) == []


def test_contents_of_one_size_are_a_table_up_to_the_last_byte() -> None:
    found = batch(b"abc", b"de", b"fgh", channels={1: CHANNEL})
    assert [bytes(row) for row in found.table(np.array([0, 2]), 3)] == [b"abc", b"fgh"]
