"""Where the records of an MCAP file are, also in one that is cut off or damaged.

The format is that of the MCAP specification (https://mcap.dev/spec).
"""

from __future__ import annotations

import mmap
import re
import struct
from collections.abc import Callable, Iterable, Iterator

from mcap.opcode import Opcode

from zenoh_cbef.log.mcap.contents import MESSAGE, RECORD, Chunk, Record
from zenoh_cbef.log.mcap.writer import MAGIC

IN_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)

_CHUNK = struct.Struct("<BQQQQII")
_IN_DATA = {
    Opcode.HEADER,
    Opcode.CHUNK,
    Opcode.MESSAGE_INDEX,
    Opcode.ATTACHMENT,
    Opcode.METADATA,
    *IN_CHUNKS,
}
_ENTRIES = 6
"""Bytes of a message index before its entries: the channel, and how many bytes of entries there are."""
_LEAST_LENGTH: dict[int, int] = {Opcode.MESSAGE: MESSAGE.size, Opcode.MESSAGE_INDEX: _ENTRIES}
# Between the opcode and the compression's name: the length, two times, the size, the CRC.
_COMPRESSED_CHUNK = re.compile(rb"\x06(?=.{36}(?:\x04\0\0\0zstd|\x03\0\0\0lz4))", re.DOTALL)


class RecordWalk:
    """The records of a data section, from the magic to data_end.

    complete: whether the file has its footer. report takes a sentence for each fault that is met.
    """

    def __init__(self, data: mmap.mmap, data_end: int, *, complete: bool, report: Callable[[str], None]) -> None:
        self._bytes, self._data_end, self._complete, self._report = data, data_end, complete, report

    def number(self, position: int, size: int) -> int:
        """Read a number of some bytes."""
        return int.from_bytes(self._bytes[position : position + size], "little")

    def end(self, position: int) -> int:
        """Where the record at a position ends, by what it says."""
        return position + RECORD.size + self.number(position + 1, 8)

    def records(self) -> Iterator[Record]:
        """Yield the records of the data section; go on at a next chunk where a length cannot be trusted.

        The last one may be cut: it then ends beyond the data.
        """
        position = len(MAGIC)
        while position < self._data_end:
            record = Record(self._bytes[position], position, self.end(position))
            if self._sound(record):
                yield record
                if record.opcode == Opcode.DATA_END:
                    return
                position = record.end
                continue
            following = self._next_chunk(position + 1)
            cut = not self._complete and record.end > self._data_end and following == self._data_end
            fault = "the file ends inside a record" if cut else "a record's length is wrong"
            self._report(f"{fault} at byte {position}")
            if cut:
                yield record
            position = following
        if self._complete:
            self._report(f"the data section ends at byte {position} without its closing record")

    def _next_chunk(self, position: int) -> int:
        """Find the next compressed chunk: its compression's name stands there, and its lengths fit."""
        for found in _COMPRESSED_CHUNK.finditer(self._bytes, position):
            start = found.start()
            if self.chunk(Record(Opcode.CHUNK, start, self.end(start))):
                return start
        return self._data_end

    def _sound(self, record: Record) -> bool:
        """Whether a record lies in the data and agrees with its length; an unexpected kind is reported."""
        length = record.end - record.start - RECORD.size
        # No record is of kind 0, and a hole in a file reads as zeros: there can be any number of them.
        if record.opcode == 0 or record.end > self._data_end or length < _LEAST_LENGTH.get(record.opcode, 0):
            return False
        if record.opcode == Opcode.CHUNK:
            return self.chunk(record) is not None
        if record.opcode == Opcode.MESSAGE_INDEX:
            return self.number(record.start + 11, 4) + _ENTRIES == length
        if record.opcode == Opcode.DATA_END:
            return length == 4
        if record.opcode not in _IN_DATA or (record.opcode == Opcode.HEADER) != (record.start == len(MAGIC)):
            self._report(f"record at byte {record.start} is of the unexpected kind {record.opcode}")
        return True

    def entries(self, chunk: Record) -> bytes:
        """The entries of the message indexes behind a chunk, as far as these follow it: log times and offsets."""
        found, position = [], chunk.end
        while position < self._data_end and self._bytes[position] == Opcode.MESSAGE_INDEX:
            begin, position = position + RECORD.size + _ENTRIES, self.end(position)
            if not begin <= position <= self._data_end:
                break
            found.append(self._bytes[begin:position])
        return b"".join(found)

    def start_time(self, record: Record) -> int:
        """The first log time (ns) of a chunk or message, by what it says; 0 where it is cut."""
        if record.opcode == Opcode.MESSAGE:
            return self.number(record.start + RECORD.size + 6, 8)
        found = self.chunk(record)
        return found.start_time if found else 0

    def chunk(self, record: Record) -> Chunk | None:
        """Read what a chunk says of its data; None for other records and where lengths contradict."""
        if record.opcode != Opcode.CHUNK or record.start + _CHUNK.size + 8 > len(self._bytes):
            return None
        _, _, start_time, end_time, size, crc, name_length = _CHUNK.unpack_from(self._bytes, record.start)
        name_end = record.start + _CHUNK.size + name_length
        data_start = name_end + 8
        if data_start + self.number(name_end, 8) != record.end:
            return None
        name = self._bytes[record.start + _CHUNK.size : name_end].decode(errors="replace")
        return Chunk(start_time, end_time, name, size, crc, data_start, record.end)


def holds_messages(record: Record) -> bool:
    """Whether messages stand in a record, or it is one."""
    return record.opcode in (Opcode.CHUNK, Opcode.MESSAGE)


def with_indexes(places: Iterable[Record]) -> Iterator[tuple[Record, list[Record]]]:
    """Yield each record of a data section with the message indexes behind it; the last without, as it may be cut."""
    last: Record | None = None
    indexes: list[Record] = []
    for record in places:
        if record.opcode == Opcode.MESSAGE_INDEX:
            indexes.append(record)
            continue
        if last is not None:
            yield last, indexes
        last, indexes = record, []
    if last is not None:
        yield last, []
