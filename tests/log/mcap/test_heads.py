"""A part of a file that is sound is read by columns, any other message by message, and both give the same."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest
from mcap import records
from mcap.data_stream import RecordBuilder

from zenoh_cbef.log.mcap import contents, heads
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
from zenoh_cbef.log.mcap.heads import Batch, gathered, heads_in, record_places

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


def declared(number: int, topic: str) -> bytes:
    builder = RecordBuilder()
    records.Channel(id=number, topic=topic, message_encoding="", metadata={}, schema_id=0).write(builder)
    return bytes(builder.end())


NEW, CONTRADICTS = declared(9, "new"), declared(1, "another")


def by_columns(data: bytes, entries: bytes = b"") -> tuple[list[RawMessage], list[str], dict[int, Channel]]:
    told, known = list[str](), declarations()
    found = heads_in(data, Record(0, 0, len(data)), known, told.append, entries)
    return found.messages(), told, known.channels


def one_by_one(data: bytes) -> tuple[list[RawMessage], list[str], dict[int, Channel]]:
    told, known = list[str](), declarations()
    return list(messages_in(data, Record(0, 0, len(data)), known, told.append)), told, known.channels


@pytest.mark.parametrize(
    "data",
    [
        WHOLE,
        EMPTY,
        WHOLE + EMPTY,
        EMPTY + OTHER,
        OTHER + WHOLE + WHOLE,
        OTHER * 5,
        WHOLE + THIRD,
        NEW + WHOLE,
        WHOLE + CONTRADICTS + EMPTY,
        CONTRADICTS,
    ],
    ids=len,
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


def indexed(*offsets: int) -> bytes:
    """The entries of a message index: log times, which no reader of places looks at, and offsets."""
    return b"".join(struct.pack("<QQ", 0, offset) for offset in offsets)


def test_an_index_that_names_all_messages_spares_looking_for_them(monkeypatch: pytest.MonkeyPatch) -> None:
    data = WHOLE + EMPTY + WHOLE
    places = 0, len(WHOLE), len(WHOLE + EMPTY)
    expected = one_by_one(data)
    monkeypatch.setattr(heads, "record_places", None)
    for order in (places, places[::-1]):
        assert by_columns(data, indexed(*order)) == expected


def test_an_index_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    data = OTHER + WHOLE + NEW + EMPTY
    first, last = len(OTHER), len(OTHER + WHOLE + NEW)
    monkeypatch.setattr(heads, "messages_in", None)
    expected, *_ = by_columns(data)
    assert len(expected) == 2
    for place in (*range(len(data) + 20), 1 << 40, (1 << 63) - 1, (1 << 64) - 1):
        for entries in (indexed(place), indexed(first, place), indexed(place, last), indexed(first, last)[:-1]):
            assert by_columns(data, entries)[0] == expected


def test_a_record_that_is_longer_than_any_is_not_passed_by_its_index(monkeypatch: pytest.MonkeyPatch) -> None:
    data = EMPTY + WHOLE + EMPTY
    for module in (heads, contents):
        monkeypatch.setattr(module, "MAX_RECORD_BYTES", MESSAGE.size)
    found = by_columns(data, indexed(0, len(EMPTY), len(EMPTY + WHOLE)))
    assert found == one_by_one(data)
    assert len(found[0]) == 2


def test_the_longest_record_has_256_mebibytes() -> None:
    longest = 1 << 28
    for length, found in ((longest, [0]), (longest + 1, None)):
        places = record_places(RECORD.pack(9, length), Record(0, 0, RECORD.size + length))
        assert (None if places is None else places.tolist()) == found


def test_batches_are_joined_until_they_have_16_mebibytes() -> None:
    known = {1: CHANNEL}
    small = batch(b"c", channels=known)
    for size, joined in (((1 << 24) - 1, 1), (1 << 24, 2)):
        assert len(list(gathered([replace(small, data=bytes(size)), small]))) == joined


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
    monkeypatch.setattr(heads, "_AT_ONCE", 3)
    parts = [batch(one, channels=known) for one in (b"abc", b"de", b"fg")]
    assert [len(one) for one in gathered(parts)] == [1, 2]
    assert list(gathered([])) == []


def test_contents_of_one_size_are_a_table_up_to_the_last_byte() -> None:
    found = batch(b"abc", b"de", b"fgh", channels={1: CHANNEL})
    assert [bytes(row) for row in found.table(np.array([0, 2]), 3)] == [b"abc", b"fgh"]
