"""Reads MCAP files, complete, cut off or damaged, and says what is wrong with them.

The format is that of the MCAP specification (https://mcap.dev/spec).
"""

from __future__ import annotations

import mmap
import re
import struct
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import zstandard
from mcap import records
from mcap.opcode import Opcode

from zenoh_cbef.log.mcap_contents import (
    RECORD,
    Chunk,
    Closing,
    Declarations,
    NotMcapError,
    RawMessage,
    Record,
    Summary,
    decompress,
    parse_record,
)
from zenoh_cbef.log.mcap_writer import MAGIC

MAX_DAMAGE = 1000

_MESSAGE_OPCODE = int(Opcode.MESSAGE)
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<BQQQQII")
_FOOTER = struct.Struct("<BQQQI")
_IN_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_IN_DATA = {
    Opcode.HEADER,
    Opcode.CHUNK,
    Opcode.MESSAGE_INDEX,
    Opcode.ATTACHMENT,
    Opcode.METADATA,
    *_IN_CHUNKS,
}
_LEAST_LENGTH: dict[int, int] = {Opcode.MESSAGE: _MESSAGE.size, Opcode.MESSAGE_INDEX: 6}
# Between the opcode and the compression's name: the length, two times, the size, the CRC.
_COMPRESSED_CHUNK = re.compile(rb"\x06(?=.{36}(?:\x04\0\0\0zstd|\x03\0\0\0lz4))", re.DOTALL)


class McapFile:
    """An MCAP file on disk, which must not shrink while it is open.

    What cannot be trusted is left out and named in damage. NotMcapError for a path that is no MCAP file,
    OSError for one that cannot be opened, UserError when lz4 is needed and not installed.

    complete: whether the closing footer and magic are there. damage: one sentence for each fault met so far,
    at most MAX_DAMAGE of them; all are met once messages() has run to its end. What the format guards with no
    CRC cannot be told true: metadata in a file without a footer, and the last chunk of it when that is cut.
    """

    def __init__(self, path: Path) -> None:
        if path.exists() and not path.is_file():
            raise NotMcapError(f"{path} is not a file")
        with path.open("rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise NotMcapError(f"{path} is not an MCAP file: it does not begin with the MCAP magic")
            self._bytes = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        self.damage: list[str] = []
        self._data_end = size = len(self._bytes)
        footer = max(0, size - len(MAGIC) - _FOOTER.size)
        magics = self._bytes[footer : footer + RECORD.size], self._bytes[-len(MAGIC) :]
        self.complete = magics == (RECORD.pack(Opcode.FOOTER, _FOOTER.size - RECORD.size), MAGIC)
        self._closing = self._read_closing(footer) if self.complete else None
        if not self.complete:
            self._report(f"the file ends at byte {size} without a footer")

    @cached_property
    def attachments(self) -> dict[str, bytes]:
        """The attachments by name, without those that fail their CRC."""
        found = self._extras(Opcode.ATTACHMENT, records.Attachment)
        return {attachment.name: attachment.data for attachment in found}

    @cached_property
    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata by name."""
        return {found.name: found.metadata for found in self._extras(Opcode.METADATA, records.Metadata)}

    def messages(self) -> Iterator[RawMessage]:
        """Yield the messages of every sound chunk in file order, up to a cut.

        Of a chunk that is cut off and not compressed, the whole messages are yielded as well.
        """
        declared = self._closing.declared if self._closing else Declarations()
        chunked, count, crc, checked = False, 0, 0, 0
        for record in self._records():
            found: list[RawMessage] = []
            if record.opcode == Opcode.CHUNK:
                chunked = True
                found = self._chunk_messages(record, declared)
            elif record.opcode == Opcode.DATA_END:
                crc = zlib.crc32(self._bytes[checked : record.start], crc)
                if self._number(record.end - 4, 4) not in (0, crc):
                    self._report("the data section fails its CRC")
            elif record.opcode == Opcode.MESSAGE and chunked:
                # One flipped bit makes a message index look like a message.
                self._report(f"message at byte {record.start} stands among chunks")
            elif record.opcode in _IN_CHUNKS and record.end <= self._data_end:
                found = self._contents(self._bytes, record, declared)
            crc, checked = zlib.crc32(self._bytes[checked : record.end], crc), record.end
            count += len(found)
            yield from found
        written = self._closing.statistics.message_count if self._closing else count
        if written != count:
            self._report(f"{count} messages are readable of {written} that were written")

    def summary(self) -> Summary:
        """Say what the file holds: from its statistics, or by reading all of it where it has none."""
        header = Record(Opcode.HEADER, len(MAGIC), self._end(len(MAGIC)))
        library = "".join(found.library for found in self._parsed([header], records.Header))
        counts: Counter[str] = Counter()
        if self._closing:
            said = self._closing.statistics
            for number, channel in self._closing.declared.channels.items():
                counts[channel.topic] += said.channel_message_counts.get(number, 0)
            start, end, totals = said.message_start_time, said.message_end_time, self._closing.chunk_totals
            return Summary(library, said.message_count, dict(counts), start, end, *totals)
        start, end = 1 << 64, 0
        for message in self.messages():
            counts[message.channel.topic] += 1
            start, end = min(start, message.log_time), max(end, message.log_time)
        chunks = [chunk for record in self._records() if (chunk := self._chunk(record))]
        compressed = sum(chunk.data_end - chunk.data_start for chunk in chunks)
        totals = [len(chunks), compressed, sum(chunk.size for chunk in chunks)]
        return Summary(library, counts.total(), dict(counts), start if counts else 0, end, *totals)

    def _report(self, sentence: str) -> None:
        if len(self.damage) < MAX_DAMAGE and sentence not in self.damage:
            self.damage.append(sentence)

    def _number(self, position: int, size: int) -> int:
        return int.from_bytes(self._bytes[position : position + size], "little")

    def _end(self, position: int) -> int:
        return position + RECORD.size + self._number(position + 1, 8)

    def _read_closing(self, footer: int) -> Closing | None:
        """Read the summary section, which also tells where the data section ends."""
        self._data_end = footer
        _, _, start, _, crc = _FOOTER.unpack_from(self._bytes, footer)
        if start == 0:
            return None
        section = self._bytes[start : footer + _FOOTER.size - 4]
        if not len(MAGIC) <= start <= footer or crc not in (0, zlib.crc32(section)):
            self._report("the summary fails its CRC")
            return None
        self._data_end = start
        try:
            return Closing(section[: footer - start])
        except (ValueError, struct.error):
            # Legal: the specification lets a writer leave any part of the summary out.
            return None

    def _extras(self, kind: Opcode, parser: Any) -> Iterator[Any]:
        """Yield the attachments or metadata: by their indexes where there are any."""
        places = self._closing.extras if self._closing else self._records()
        return self._parsed((record for record in places if record.opcode == kind), parser)

    def _parsed(self, places: Iterable[Record], parser: Any) -> Iterator[Any]:
        for record in places:
            name = f"{parser.__name__.lower()} at byte {record.start}"
            if self._bytes[record.start : record.start + 1] != bytes((record.opcode,)):
                self._report(f"{name} is not where it should be")
                continue
            try:
                yield parse_record(parser, self._bytes[record.start + RECORD.size : record.end])
            except ValueError as error:
                self._report(f"{name} is damaged: {error}")

    def _records(self) -> Iterator[Record]:
        """Yield the records of the data section; go on at a next chunk where a length cannot be trusted.

        The last one may be cut: it then ends beyond the data.
        """
        position = len(MAGIC)
        while position < self._data_end:
            record = Record(self._bytes[position], position, self._end(position))
            if self._sound(record):
                yield record
                if record.opcode == Opcode.DATA_END:
                    return
                position = record.end
                continue
            following = self._next_chunk(position + 1)
            cut = not self.complete and record.end > self._data_end and following == self._data_end
            fault = "the file ends inside a record" if cut else "a record's length is wrong"
            self._report(f"{fault} at byte {position}")
            if cut:
                yield record
            position = following
        if self.complete:
            self._report(f"the data section ends at byte {position} without its closing record")

    def _next_chunk(self, position: int) -> int:
        """Find the next compressed chunk, which is told by its compression's name and matching lengths."""
        for found in _COMPRESSED_CHUNK.finditer(self._bytes, position):
            start = found.start()
            if self._chunk(Record(Opcode.CHUNK, start, self._end(start))):
                return start
        return self._data_end

    def _sound(self, record: Record) -> bool:
        """Whether a record lies in the data and agrees with its length; an unexpected kind is reported."""
        length = record.end - record.start - RECORD.size
        if record.end > self._data_end or length < _LEAST_LENGTH.get(record.opcode, 0):
            return False
        if record.opcode == Opcode.CHUNK:
            return self._chunk(record) is not None
        if record.opcode == Opcode.MESSAGE_INDEX:
            return self._number(record.start + 11, 4) + 6 == length
        if record.opcode == Opcode.DATA_END:
            return length == 4
        if record.opcode not in _IN_DATA or (record.opcode == Opcode.HEADER) != (record.start == len(MAGIC)):
            self._report(f"record at byte {record.start} is of the unexpected kind {record.opcode}")
        return True

    def _chunk(self, record: Record) -> Chunk | None:
        """Read what a chunk says of its data; None for other records and where lengths contradict."""
        if record.opcode != Opcode.CHUNK or record.start + _CHUNK.size + 8 > len(self._bytes):
            return None
        *_, size, crc, name_length = _CHUNK.unpack_from(self._bytes, record.start)
        name_end = record.start + _CHUNK.size + name_length
        data_start = name_end + 8
        if data_start > record.end or data_start + self._number(name_end, 8) != record.end:
            return None
        name = self._bytes[record.start + _CHUNK.size : name_end].decode(errors="replace")
        return Chunk(name, size, crc, data_start, record.end)

    def _chunk_messages(self, record: Record, declared: Declarations) -> list[RawMessage]:
        chunk = self._chunk(record)
        if chunk is None:
            return []
        if record.end > self._data_end:
            cut = Record(record.opcode, chunk.data_start, self._data_end)
            return [] if chunk.compression else self._contents(self._bytes, cut, declared)
        try:
            data = decompress(self._bytes[chunk.data_start : chunk.data_end], chunk)
        except (ValueError, RuntimeError, EOFError, MemoryError, zstandard.ZstdError) as error:
            self._report(f"chunk at byte {record.start} is damaged: {error}")
            return []
        if chunk.crc not in (0, zlib.crc32(data)):
            self._report(f"chunk at byte {record.start} fails its CRC")
            return []
        return self._contents(data, Record(record.opcode, 0, len(data)), declared)

    def _contents(self, data: bytes | mmap.mmap, part: Record, declared: Declarations) -> list[RawMessage]:
        """Take the declarations and messages of a part of the data, up to a record that is cut."""
        found: list[RawMessage] = []
        _, position, end = part
        while position + RECORD.size <= end:
            opcode, length = RECORD.unpack_from(data, position)
            start, position = position + RECORD.size, position + RECORD.size + length
            if position > end:
                break
            try:
                if opcode == _MESSAGE_OPCODE:
                    channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, start)
                    content = data[start + _MESSAGE.size : position]
                    found.append(RawMessage(declared.channels[channel], log_time, publish_time, sequence, content))
                else:
                    declared.add(opcode, data[start:position])
            except KeyError as error:
                self._report(f"channel {error} has messages and is not declared")
            except (ValueError, struct.error) as error:
                self._report(f"a declaration or message is damaged: {error}")
        if position != end:
            self._report("a chunk ends inside a record")
        return found
