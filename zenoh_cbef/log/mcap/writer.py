"""A lean MCAP writer: one packed struct per message, one write to the system per chunk.

The format is that of the MCAP specification (https://mcap.dev/spec).
"""

from __future__ import annotations

import os
import struct
import zlib
from array import array
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Literal, Self

import numpy as np
import zstandard
from mcap.opcode import Opcode

from zenoh_cbef.extras import from_extra
from zenoh_cbef.log.mcap.pile import Pile

Compression = Literal["zstd", "lz4", "none"]

MAGIC = b"\x89MCAP0\r\n"
MAX_ID = 0xFFFF

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_OPCODE = int(Opcode.MESSAGE)
_MESSAGE_FIELDS = _MESSAGE.size - _RECORD.size
_CHUNK = struct.Struct("<QQQI")
_SUMMARY_ORDER = (
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.STATISTICS,
    Opcode.CHUNK_INDEX,
    Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX,
)

# macOS has no fdatasync
_sync_data: Callable[[int], None] = getattr(os, "fdatasync", os.fsync)


class McapWriter:
    """Writes one MCAP file, replacing what was at the path. Used by one thread at a time.

    Every chunk declares the schemas and channels it uses, so that each chunk can be read by itself when the
    file is cut off or damaged elsewhere. Chunks, the data section, attachments and the summary carry a CRC.

    When a write fails (disk full), OSError is raised, the file is cut back to its last whole record, and what the
    failed write held is dropped, the messages of the open chunk included; the writer stays usable.

    compression: of the chunks; lz4 needs the package of that name (MissingExtra if it is missing). chunk_bytes:
    size at which a chunk ends, before compression. library: names the writing program in the file's header.

    bytes_written: size of the file. message_count: messages added and not dropped by a failed write.
    """

    def __init__(
        self,
        path: Path,
        *,
        compression: Compression = "zstd",
        chunk_bytes: int = 1 << 20,
        library: str,
    ) -> None:
        self.bytes_written = 0
        self.message_count = 0
        self._compression = b"" if compression == "none" else compression.encode()
        self._compress = _compressor(compression)
        self._chunk_bytes = chunk_bytes
        self._chunk = bytearray()
        self._indexes: dict[int, array[int]] = {}
        self._schemas: dict[int, bytes] = {0: b""}
        self._channels: dict[int, bytes] = {}
        self._message_counts: Counter[int] = Counter()
        self._record_counts: Counter[Opcode] = Counter()
        self._times: tuple[int, int] | None = None
        self._summary = {opcode: Pile(path.parent) for opcode in _SUMMARY_ORDER}
        self._data_crc = 0
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        try:
            self._write(MAGIC + _record(Opcode.HEADER, _text("") + _text(library)))
        except OSError:
            os.close(self._file)
            path.unlink(missing_ok=True)  # an empty file would be taken for a log
            raise
        self._open, self._gone = True, False

    @property
    def gone(self) -> bool:
        """Whether the file was removed while it was open: no reader finds what was written into it."""
        return os.fstat(self._file).st_nlink == 0 if self._open else self._gone

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a schema and return its number, from 1; ValueError when there are more than MAX_ID."""
        number = _next_number(len(self._schemas), "schemas")
        content = struct.pack("<H", number) + _text(name) + _text(encoding) + _sized(data)
        self._schemas[number] = record = _record(Opcode.SCHEMA, content)
        self._summarise(Opcode.SCHEMA, record)
        return number

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: Mapping[str, str] = {}
    ) -> int:
        """Declare a channel and return its number, from 1.

        schema_id: 0 for none. ValueError when it is not registered or there are more than MAX_ID channels.
        """
        if schema_id not in self._schemas:
            raise ValueError(f"no schema {schema_id} is registered")
        number = _next_number(len(self._channels) + 1, "channels")
        content = struct.pack("<HH", number, schema_id) + _text(topic) + _text(message_encoding)
        record = _record(Opcode.CHANNEL, content + _mapping(metadata))
        self._channels[number] = self._schemas[schema_id] + record
        self._summarise(Opcode.CHANNEL, record)
        return number

    def add_message(self, channel_id: int, log_time: int, publish_time: int, sequence: int, data: bytes) -> None:
        """Add a message to the open chunk, which is written out when it is full.

        Times are in ns since the epoch. sequence: its low 32 bits are kept. ValueError for a channel that is
        not registered; struct.error, with nothing added, for a time outside 64 bits.
        """
        index = self._indexes.get(channel_id)
        if index is None:
            index = self._declare(channel_id)
        chunk = self._chunk
        offset = len(chunk)
        length = _MESSAGE_FIELDS + len(data)
        sequence &= 0xFFFFFFFF
        chunk += _MESSAGE.pack(_MESSAGE_OPCODE, length, channel_id, sequence, log_time, publish_time) + data
        index.append(log_time)
        index.append(offset)
        self.message_count += 1
        if offset >= self._chunk_bytes:
            self._end_chunk()

    def add_attachment(self, name: str, media_type: str, data: bytes, log_time: int = 0) -> None:
        """Write an attachment at once. log_time: ns since the epoch, 0 for unknown."""
        content = struct.pack("<QQ", log_time, 0) + _text(name) + _text(media_type)
        content += struct.pack("<Q", len(data)) + data
        record = _record(Opcode.ATTACHMENT, content + struct.pack("<I", zlib.crc32(content)))
        index = struct.pack("<QQQQQ", self.bytes_written, len(record), log_time, 0, len(data))
        self._write(record)
        self._summarise(
            Opcode.ATTACHMENT_INDEX, _record(Opcode.ATTACHMENT_INDEX, index + _text(name) + _text(media_type))
        )

    def add_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        """Write a named set of texts at once."""
        record = _record(Opcode.METADATA, _text(name) + _mapping(metadata))
        index = struct.pack("<QQ", self.bytes_written, len(record)) + _text(name)
        self._write(record)
        self._summarise(Opcode.METADATA_INDEX, _record(Opcode.METADATA_INDEX, index))

    def flush(self, *, sync: bool = False) -> None:
        """End the open chunk and hand it to the operating system; with sync, to the disk."""
        self._end_chunk()
        if sync and self._open:
            _sync_data(self._file)

    def close(self) -> None:
        """Write the open chunk, the summary and the footer, and close the file; once closed, do nothing."""
        if not self._open:
            return
        try:
            self._end_chunk()
            self._write(_record(Opcode.DATA_END, struct.pack("<I", self._data_crc)))
            self._write(self._closing())
        finally:
            self._gone, self._open = self.gone, False
            self._channels.clear()
            self._indexes.clear()
            os.close(self._file)
            for pile in self._summary.values():
                pile.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _declare(self, channel_id: int) -> array[int]:
        """Begin a channel's message index in the open chunk."""
        declaration = self._channels.get(channel_id)
        if declaration is None:
            raise ValueError(f"no channel {channel_id} is registered, or the file is closed")
        self._chunk += declaration
        index = array("Q")
        self._indexes[channel_id] = index
        return index

    def _end_chunk(self) -> None:
        chunk, indexes = self._chunk, self._indexes
        counts = {channel: len(index) // 2 for channel, index in indexes.items() if index}
        if not counts:
            return
        self._chunk, self._indexes = bytearray(), {}
        # Times and offsets in turn.
        entries = {channel: np.asarray(indexes[channel]).astype("<u8", copy=False) for channel in counts}
        start = min(int(each[::2].min()) for each in entries.values())
        end = max(int(each[::2].max()) for each in entries.values())
        compressed = self._compress(chunk)
        head = _CHUNK.pack(start, end, len(chunk), zlib.crc32(chunk))
        head += _sized(self._compression) + struct.pack("<Q", len(compressed))
        chunk_length = _RECORD.size + len(head) + len(compressed)
        block = bytearray(_RECORD.pack(Opcode.CHUNK, chunk_length - _RECORD.size) + head + compressed)
        offsets = b""
        for channel, each in entries.items():
            offsets += struct.pack("<HQ", channel, self.bytes_written + len(block))
            block += _record(Opcode.MESSAGE_INDEX, struct.pack("<H", channel) + _sized(each.tobytes()))
        index = struct.pack("<QQQQ", start, end, self.bytes_written, chunk_length) + _sized(offsets)
        index += struct.pack("<Q", len(block) - chunk_length) + _sized(self._compression)
        index += struct.pack("<QQ", len(compressed), len(chunk))
        try:
            self._write(block)
        except BaseException:
            self.message_count -= sum(counts.values())
            raise
        self._summarise(Opcode.CHUNK_INDEX, _record(Opcode.CHUNK_INDEX, index))
        self._message_counts.update(counts)
        first, last = self._times or (start, end)
        self._times = min(first, start), max(last, end)

    def _write(self, data: bytes | bytearray) -> None:
        rest = memoryview(data)
        end = self.bytes_written
        try:
            while rest:
                written = os.pwrite(self._file, rest, end)
                end, rest = end + written, rest[written:]
        except BaseException:
            with suppress(OSError):
                os.ftruncate(self._file, self.bytes_written)
            raise
        self._data_crc = zlib.crc32(data, self._data_crc)
        self.bytes_written = end

    def _summarise(self, opcode: Opcode, record: bytes) -> None:
        self._summary[opcode].add(record)
        self._record_counts[opcode] += 1

    def _closing(self) -> bytes:
        """Return the summary section, the footer and the magic, for the end of the file as it is."""
        summary, offsets = bytearray(), bytearray()
        for opcode, pile in self._summary.items():
            group = self._statistics() if opcode is Opcode.STATISTICS else pile.read()
            if group:
                place = struct.pack("<BQQ", opcode, self.bytes_written + len(summary), len(group))
                offsets += _record(Opcode.SUMMARY_OFFSET, place)
                summary += group
        start = self.bytes_written
        footer = _RECORD.pack(Opcode.FOOTER, 20) + struct.pack("<QQ", start, start + len(summary))
        closing = bytes(summary + offsets) + footer
        return closing + struct.pack("<I", zlib.crc32(closing)) + MAGIC

    def _statistics(self) -> bytes:
        counts = b"".join(struct.pack("<HQ", *item) for item in self._message_counts.items())
        schemas, channels, _, chunks, *others = (self._record_counts[o] for o in _SUMMARY_ORDER)
        numbers = struct.pack("<QHIIII", self._message_counts.total(), schemas, channels, *others, chunks)
        fields = numbers + struct.pack("<QQ", *(self._times or (0, 0)))
        return _record(Opcode.STATISTICS, fields + _sized(counts))


def _compressor(compression: Compression) -> Callable[[bytearray], bytes]:
    if compression == "zstd":
        return zstandard.ZstdCompressor(level=1).compress
    if compression == "none":
        return bytes
    compress: Callable[[bytearray], bytes] = from_extra("lz4.frame", 'record.compression = "lz4"').compress
    return compress


def _next_number(number: int, what: str) -> int:
    if number > MAX_ID:
        raise ValueError(f"an MCAP file holds at most {MAX_ID} {what}")
    return number


def _record(opcode: int, content: bytes) -> bytes:
    return _RECORD.pack(opcode, len(content)) + content


def _sized(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def _text(value: str) -> bytes:
    return _sized(value.encode())


def _mapping(values: Mapping[str, str]) -> bytes:
    return _sized(b"".join(_text(key) + _text(value) for key, value in values.items()))
