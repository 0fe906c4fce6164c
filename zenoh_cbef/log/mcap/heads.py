"""The messages of a chunk as columns: what their records say is read at once, and their data stays where it is."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from zenoh_cbef.arrays import Ints
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

Bytes = NDArray[np.uint8]

_AT_ONCE = 1 << 24
_HEAD = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("number", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
_ANY_HEAD = np.dtype([("opcode", "u1"), ("length", "<u8")])
_ENTRY = np.dtype([("log", "<u8"), ("offset", "<u8")])
_LENGTH = struct.Struct("<xQ")


@dataclass(frozen=True)
class Batch:
    """Messages (m,) in file order: where their contents are in `data`, and what their records say.

    channel: ids, keys of `channels`. number: sequence numbers of 32 bits. log, publish: times, ns since the epoch.
    chunk: numbers of the chunks that they are from, from 0.
    """

    data: bytes
    channels: Mapping[int, Channel]
    channel: Ints
    number: Ints
    log: NDArray[np.uint64]
    publish: NDArray[np.uint64]
    start: Ints
    end: Ints
    chunk: Ints

    @classmethod
    def of(cls, messages: Sequence[RawMessage], channels: Mapping[int, Channel]) -> Batch:
        """The same messages as columns; channels: with theirs."""
        own, log, publish, number, contents = zip(*messages, strict=True) if messages else ((),) * 5
        ends = np.array([0, *accumulate(map(len, contents))], dtype=np.int64)
        return cls(
            data=b"".join(contents),
            channels=channels,
            channel=np.array([one.id for one in own], dtype=np.int64),
            number=np.array(number, dtype=np.int64),
            log=np.array(log, dtype=np.uint64),
            publish=np.array(publish, dtype=np.uint64),
            start=ends[:-1],
            end=ends[1:],
            chunk=np.zeros(len(own), dtype=np.int64),
        )

    def __len__(self) -> int:
        """How many messages there are."""
        return len(self.channel)

    def contents(self, rows: Ints) -> list[bytes]:
        """The contents of some messages."""
        data = self.data
        return [data[a:b] for a, b in zip(self.start[rows].tolist(), self.end[rows].tolist(), strict=True)]

    def table(self, rows: Ints, size: int) -> Bytes:
        """The contents of some messages of one size, (m, size)."""
        # Whole rows are copied, where an index for each byte would take several times as long.
        windows = np.ndarray((len(self.data) - size + 1,), f"V{size}", self.data, strides=(1,))
        return windows[self.start[rows]].view(np.uint8).reshape(len(rows), size)

    def message(self, row: int) -> RawMessage:
        """One message."""
        (content,) = self.contents(np.array([row]))
        times = int(self.log[row]), int(self.publish[row])
        return RawMessage(self.channels[int(self.channel[row])], *times, int(self.number[row]), content)

    def messages(self) -> list[RawMessage]:
        """The messages one by one."""
        channels = map(self.channels.__getitem__, self.channel.tolist())
        contents = self.contents(np.arange(len(self)))
        columns = zip(channels, self.log.tolist(), self.publish.tolist(), self.number.tolist(), contents, strict=True)
        # tuple.__new__ takes half as long as the class's own constructor.
        new = tuple.__new__
        return [new(RawMessage, one) for one in columns]


def heads_in(
    data: bytes | mmap.mmap,
    part: Record,
    declared: Declarations,
    report: Callable[[str], None],
    entries: bytes = b"",
) -> Batch:
    """As `messages_in`, by columns. What is not sound from end to end is read message by message.

    entries: of the indexes of the part, where it has any.
    """
    found = _sound(data, part, declared, report, entries) if isinstance(data, bytes) else None
    return Batch.of(messages_in(data, part, declared, report), declared.channels) if found is None else found


def gathered(batches: Iterable[Batch]) -> Iterator[Batch]:
    """The same messages in fewer, larger batches: what is done once for a batch counts less."""
    waiting: list[Batch] = []
    size = 0
    for one in batches:
        if waiting and (size >= _AT_ONCE or one.channels is not waiting[0].channels):
            yield _joined(waiting)
            waiting, size = [], 0
        waiting.append(one)
        size += len(one.data)
    if waiting:
        yield _joined(waiting)


def _sound(
    data: bytes, part: Record, declared: Declarations, report: Callable[[str], None], entries: bytes
) -> Batch | None:
    """The messages of a part whose records fill it, and whose channels were declared before; None for another part."""
    places = _indexed(data, part, entries)
    places = record_places(data, part) if places is None else places
    if places is None or len(data) < _HEAD.itemsize:
        return None
    is_message = np.frombuffer(data, np.uint8)[places] == int(Opcode.MESSAGE)
    records = places[is_message]
    if len(records) and records[-1] + _HEAD.itemsize > len(data):
        return None
    heads = np.ndarray((len(data) - _HEAD.itemsize + 1,), _HEAD, data, strides=(1,))[records]
    length, channel = heads["length"].astype(np.int64), heads["channel"].astype(np.int64)
    used = set(np.flatnonzero(np.bincount(channel)).tolist())
    if (length < MESSAGE.size).any() or not declared.channels.keys() >= used:
        return None
    for place in places[~is_message].tolist():
        opcode, size = RECORD.unpack_from(data, place)
        try:
            declared.add(opcode, data[place + RECORD.size : place + RECORD.size + size])
        except (ValueError, struct.error) as error:
            report(f"a declaration is damaged: {error}")
    return Batch(
        data=data,
        channels=declared.channels,
        channel=channel,
        number=heads["number"].astype(np.int64),
        log=heads["log"].astype(np.uint64),
        publish=heads["publish"].astype(np.uint64),
        start=records + _HEAD.itemsize,
        end=records + RECORD.size + length,
        chunk=np.zeros(len(records), dtype=np.int64),
    )


def _indexed(data: bytes, part: Record, entries: bytes) -> Ints | None:
    """As `record_places`, with what indexes say of the messages among them; None where that does not lead to the end.

    It needs no trust: from each record its length leads to the next, so places that are wrong break the chain.
    """
    if not entries or len(entries) % _ENTRY.itemsize:
        return None
    named = np.sort(np.frombuffer(entries, _ENTRY)["offset"].astype(np.int64))
    if named[0] < part.start or named[-1] > part.end - RECORD.size:
        return None
    heads = np.ndarray((len(data) - RECORD.size + 1,), _ANY_HEAD, data, strides=(1,))
    length = heads["length"][named]
    if (length > MAX_RECORD_BYTES).any():
        return None
    ends = np.concatenate([[part.start], named + RECORD.size + length.astype(np.int64)])
    found = [named]
    for hole in np.flatnonzero(ends != np.append(named, part.end)).tolist():
        # Indexes tell of messages alone, and a channel is declared before its first message.
        until = int(named[hole]) if hole < len(named) else part.end
        between = record_places(data, Record(part.opcode, int(ends[hole]), until))
        if between is None:
            return None
        found.append(between)
    return np.sort(np.concatenate(found)) if len(found) > 1 else named


def record_places(data: bytes, part: Record) -> Ints | None:
    """Where the records of a part begin; None where they do not fill it, or one is larger than any."""
    places: list[int] = []
    add, length_at, (_, position, end) = places.append, _LENGTH.unpack_from, part
    last = end - RECORD.size
    while position <= last:
        add(position)
        (length,) = length_at(data, position)
        position += RECORD.size + length
        if length > MAX_RECORD_BYTES:
            return None
    return np.array(places, dtype=np.int64) if position == end else None


def _joined(batches: Sequence[Batch]) -> Batch:
    first = batches[0]
    if len(batches) == 1:
        return first
    before = np.array([0, *accumulate(len(one.data) for one in batches[:-1])], dtype=np.int64)
    counts = [len(one) for one in batches]
    shift = np.repeat(before, counts)
    columns = {
        name: np.concatenate([getattr(one, name) for one in batches])
        for name in ("channel", "number", "log", "publish", "start", "end")
    }
    columns["start"] += shift
    columns["end"] += shift
    chunk = np.repeat(np.arange(len(batches)), counts)
    return Batch(b"".join(one.data for one in batches), first.channels, **columns, chunk=chunk)
