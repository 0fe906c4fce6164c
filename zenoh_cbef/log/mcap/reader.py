"""Reads MCAP files, complete, cut off or damaged, and says what is wrong with them.

The format is that of the MCAP specification (https://mcap.dev/spec).
"""

from __future__ import annotations

import math
import mmap
import struct
import zlib
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING

import zstandard
from mcap import records
from mcap.opcode import Opcode

from zenoh_cbef.log.mcap.contents import (
    MAX_RECORD_BYTES,
    RECORD,
    Closing,
    Declarations,
    NotMcapError,
    Parsed,
    RawMessage,
    Record,
    Summary,
    decompress,
    parse_record,
)
from zenoh_cbef.log.mcap.walk import IN_CHUNKS, RecordWalk, holds_messages, with_indexes
from zenoh_cbef.log.mcap.writer import MAGIC
from zenoh_cbef.words import counted

if TYPE_CHECKING:
    from zenoh_cbef.log.mcap.heads import Batch

MAX_DAMAGE = 1000
_AT_ONCE = 1 << 24

_LOG_TIME = attrgetter("log_time")
_FOOTER = struct.Struct("<BQQQI")


class McapFile:
    """An MCAP file on disk, which must not shrink while it is open.

    The reader leaves out what it cannot trust and names it in damage. Raises NotMcapError for a path that is no MCAP
    file, which with `headless` may be damaged from its first byte on, OSError for one that cannot be opened, UserError
    when lz4 is needed and not installed.

    complete: whether the closing footer and magic are there. closed: whether the data section was seen to end as its
    writer ended it, once messages() has run to its end. lost: one sentence for each fault of the data met so far,
    at most MAX_DAMAGE of them; all are met by then. The format has no CRC for metadata in a file without a footer, nor
    for the last chunk of it when that is cut: errors in these stay unseen.
    """

    def __init__(self, path: Path, *, headless: bool = False) -> None:
        if path.exists() and not path.is_file():
            raise NotMcapError(f"{path} is not a file")
        with path.open("rb") as stream:
            begin = stream.read(len(MAGIC))
            why = "it does not begin with the MCAP magic" if begin else "it is empty"
            if begin != MAGIC and not (headless and begin):
                raise NotMcapError(f"{path} is no MCAP file: {why}")
            self._bytes = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        self.lost = [] if begin == MAGIC else [f"the head of {path} is damaged: {why}"]
        self._reported: set[str] = set()
        self.closed, self._without_index = False, ""
        self._data_end = size = len(self._bytes)
        footer = max(0, size - len(MAGIC) - _FOOTER.size)
        magics = self._bytes[footer : footer + RECORD.size], self._bytes[-len(MAGIC) :]
        self.complete = magics == (RECORD.pack(Opcode.FOOTER, _FOOTER.size - RECORD.size), MAGIC)
        self._closing = self._read_closing(footer) if self.complete else None
        self._walk = RecordWalk(self._bytes, self._data_end, complete=self.complete, report=self._report)
        if not self.complete:
            self._without_index = f"the file ends at byte {size} without a footer"

    @property
    def damage(self) -> list[str]:
        """What was lost, and what is wrong with the summary, which can be made again."""
        return [*filter(None, [self._without_index]), *self.lost]

    @cached_property
    def attachments(self) -> dict[str, bytes]:
        """The attachments by name, without those that fail their CRC."""
        return {attachment.name: attachment.data for attachment in self.attached()}

    @cached_property
    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata by name."""
        return {found.name: found.metadata for found in self.described()}

    def attached(self) -> Iterator[records.Attachment]:
        """Yield the attachments with all their fields, in file order, without those that fail their CRC."""
        return self._extras(Opcode.ATTACHMENT, records.Attachment)

    def described(self) -> Iterator[records.Metadata]:
        """Yield the metadata in file order, several of one name included."""
        return self._extras(Opcode.METADATA, records.Metadata)

    def messages(self) -> Iterator[RawMessage]:
        """Yield the messages of every sound chunk in file order, up to a cut.

        Of a chunk that is cut off and not compressed, the whole messages are yielded as well.
        """
        for found in self.batches():
            yield from found.messages()

    def messages_in_order(self) -> Iterator[RawMessage]:
        """Yield the same messages by log time; those of one time in file order.

        Holds what chunks overlap in time, which in a log that was written as messages came is a chunk or two.
        """
        starts: list[float] = [*map(self._walk.start_time, filter(holds_messages, self._walk.records()))]
        least = math.inf
        for place in reversed(range(len(starts))):
            starts[place], least = least, min(least, starts[place])
        held: list[RawMessage] = []
        for found, until in zip(self.batches(), starts, strict=True):
            held += found.messages()
            held.sort(key=_LOG_TIME)
            ready = bisect_right(held, until, key=_LOG_TIME)
            yield from held[:ready]
            del held[:ready]

    def batches(self) -> Iterator[Batch]:
        """Yield the messages of messages(), those of a chunk together."""
        declared = self._closing.declared if self._closing else Declarations()
        chunked, count, crc, checked, kept = False, 0, 0, 0, 0
        nothing = _heads_in(b"", Record(Opcode.CHUNK, 0, 0), declared, self._report)
        for record in self._walk.records():
            found: Batch | None = None
            chunked |= record.opcode == Opcode.CHUNK
            if record.opcode == Opcode.DATA_END:
                self.closed = True
                crc = self._crc(checked, record.start, crc)
                if self._walk.number(record.end - 4, 4) not in (0, crc):
                    self._report("the data section fails its CRC")
            elif record.opcode == Opcode.MESSAGE and chunked:
                # One flipped bit makes a message index look like a message.
                self._report(f"message at byte {record.start} stands among chunks")
            else:
                found = self._messages_of(record, declared)
            if record.end - checked >= _AT_ONCE:
                crc, checked = self._crc(checked, record.end, crc), record.end
            kept = self._forget(kept, record.end)
            count += len(found or ())
            if holds_messages(record):
                yield found or nothing
        written = self._closing.statistics.message_count if self._closing else count
        if written != count:
            self._report(f"{count} of {counted(written, 'message')} that were written can be read")

    def summary(self) -> Summary:
        """Say what the file holds: from its statistics, or from its chunks' indexes where it has none."""
        header = Record(Opcode.HEADER, len(MAGIC), self._walk.end(len(MAGIC)))
        library = "".join(found.library for found in self._parsed([header], records.Header))
        if self._closing is None:
            return self._summary_of_chunks(library)
        counts: Counter[str] = Counter()
        said = self._closing.statistics
        for number, channel in self._closing.declared.channels.items():
            counts[channel.topic] += said.channel_message_counts.get(number, 0)
        return Summary(
            library=library,
            message_count=said.message_count,
            channel_counts=dict(counts),
            start_time=said.message_start_time,
            end_time=said.message_end_time,
            chunks=self._closing.chunks,
        )

    def _summary_of_chunks(self, library: str) -> Summary:
        """Count what the indexes say, and read only chunks that have none, and one for each new channel."""
        declared, counts, chunks = Declarations(), Counter[str](), 0
        start, end = 1 << 64, 0
        for record, indexes in with_indexes(self._walk.records()):
            chunk = self._walk.chunk(record)
            indexed = {self._walk.number(at.start + RECORD.size, 2): at.end - at.start for at in indexes}
            if chunk and indexed:
                if not indexed.keys() <= declared.channels.keys():
                    self._chunk_messages(record, declared)
                for number, size in indexed.items():
                    if number in declared.channels:
                        counts[declared.channels[number].topic] += (size - RECORD.size - 6) // 16
                start, end = min(start, chunk.start_time), max(end, chunk.end_time)
            else:
                found = self._messages_of(record, declared)
                for message in found.messages() if found else ():
                    counts[message.channel.topic] += 1
                    start, end = min(start, message.log_time), max(end, message.log_time)
            chunks += chunk is not None
        return Summary(
            library=library,
            message_count=counts.total(),
            channel_counts=dict(counts),
            start_time=start if counts else 0,
            end_time=end,
            chunks=chunks,
        )

    def _forget(self, start: int, end: int) -> int:
        """Return the memory of what was read to the system, much at once; returns the byte at which the rest begins."""
        if end - start < _AT_ONCE:
            return start
        end = min(end, len(self._bytes)) // mmap.PAGESIZE * mmap.PAGESIZE
        self._bytes.madvise(mmap.MADV_DONTNEED, start, end - start)
        return end

    def _crc(self, start: int, end: int, crc: int) -> int:
        """The CRC of bytes of the file; a record can claim to end later than these."""
        with memoryview(self._bytes) as whole, whole[start:end] as part:  # No copy: they may be most of the memory.
            return zlib.crc32(part, crc)

    def _report(self, sentence: str) -> None:
        if len(self._reported) < MAX_DAMAGE and sentence not in self._reported:
            self._reported.add(sentence)
            self.lost.append(sentence)

    def _read_closing(self, footer: int) -> Closing | None:
        """Read the summary section, which also tells where the data section ends."""
        self._data_end = footer
        _, _, start, _, crc = _FOOTER.unpack_from(self._bytes, footer)
        if start == 0:
            return None
        if footer - start > MAX_RECORD_BYTES:
            self._without_index = f"the summary claims to be {footer - start} bytes long"
            return None
        section = self._bytes[start : footer + _FOOTER.size - 4]
        if not len(MAGIC) <= start <= footer or crc not in (0, zlib.crc32(section)):
            self._without_index = "the summary fails its CRC"
            return None
        self._data_end = start
        try:
            return Closing(section[: footer - start])
        except (ValueError, struct.error):
            # Legal: the specification lets a writer leave any part of the summary out.
            return None

    def _extras(self, kind: Opcode, parser: type[Parsed]) -> Iterator[Parsed]:
        """Yield the attachments or metadata: by their indexes where there are any."""
        places = self._closing.extras if self._closing else self._walk.records()
        return self._parsed((record for record in places if record.opcode == kind), parser)

    def _parsed(self, places: Iterable[Record], parser: type[Parsed]) -> Iterator[Parsed]:
        for record in places:
            name = f"{parser.__name__.lower()} at byte {record.start}"
            if self._bytes[record.start : record.start + 1] != bytes((record.opcode,)):
                self._report(f"{name} is not where it should be")
                continue
            if record.end - record.start > MAX_RECORD_BYTES:
                self._report(f"{name} claims to be {record.end - record.start} bytes long")
                continue
            try:
                yield parse_record(parser, self._bytes[record.start + RECORD.size : record.end])
            except ValueError as error:
                self._report(f"{name} is damaged: {error}")

    def _messages_of(self, record: Record, declared: Declarations) -> Batch | None:
        """Take the declarations and messages of a record of the data section; None where it can hold none."""
        if record.opcode == Opcode.CHUNK:
            return self._chunk_messages(record, declared)
        if record.opcode in IN_CHUNKS and record.end <= self._data_end:
            return _heads_in(self._bytes, record, declared, self._report)
        return None

    def _chunk_messages(self, record: Record, declared: Declarations) -> Batch | None:
        chunk = self._walk.chunk(record)
        if chunk is None:
            return None
        if record.end > self._data_end:
            cut = Record(record.opcode, chunk.data_start, self._data_end)
            return None if chunk.compression else _heads_in(self._bytes, cut, declared, self._report)
        try:
            data = decompress(self._bytes[chunk.data_start : chunk.data_end], chunk)
        except (ValueError, RuntimeError, EOFError, MemoryError, zstandard.ZstdError) as error:
            self._report(f"chunk at byte {record.start} is damaged: {error}")
            return None
        if chunk.crc not in (0, zlib.crc32(data)):
            self._report(f"chunk at byte {record.start} fails its CRC")
            return None
        part = Record(record.opcode, 0, len(data))
        return _heads_in(data, part, declared, self._report, self._walk.entries(record))


def _heads_in(
    data: bytes | mmap.mmap, part: Record, declared: Declarations, report: Callable[[str], None], entries: bytes = b""
) -> Batch:
    # A verb that describes a file reads no message, and so need not wait for NumPy.
    from zenoh_cbef.log.mcap.heads import heads_in  # noqa: PLC0415

    return heads_in(data, part, declared, report, entries)
