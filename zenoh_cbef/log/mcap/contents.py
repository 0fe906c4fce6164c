"""The records of an MCAP file as they are read, checked against their own lengths and checksums.

The format is that of the MCAP specification (https://mcap.dev/spec).
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from typing import NamedTuple, TypeVar

import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from zenoh_cbef.extras import from_extra

MAX_RECORD_BYTES = 1 << 28
"""The longest attachment, declaration, message or summary: a reader reports a larger length as damage."""

MAX_CHUNK_BYTES = 1 << 29
_BOMB_BYTES, _BOMB_RATIO = 1 << 26, 200
"""A reader refuses a chunk that is larger than this, and this many times larger than its compressed data."""

NO_CRC = bytes(4)
RECORD = struct.Struct("<BQ")
MESSAGE = struct.Struct("<HIQQ")
"""The fields of a message before its data: channel, sequence, log and publish time."""


_MESSAGE_OPCODE = int(Opcode.MESSAGE)
_WHOLE_MESSAGE = struct.Struct("<BQ" + MESSAGE.format.removeprefix("<"))


Parsed = TypeVar(
    "Parsed", records.Header, records.Schema, records.Channel, records.Statistics, records.Attachment, records.Metadata
)
"""A kind of record that the public library reads."""


class NotMcapError(ValueError):
    """The path does not lead to an MCAP file."""


@dataclass(frozen=True)
class Channel:
    """What the messages of one channel have in common; schema fields are empty where there is no schema."""

    id: int
    topic: str
    message_encoding: str
    schema_name: str
    schema_encoding: str
    schema_data: bytes
    metadata: dict[str, str]


class RawMessage(NamedTuple):
    """A message as recorded: times in ns since the epoch, sequence of 32 bits, data not decoded."""

    channel: Channel
    log_time: int
    publish_time: int
    sequence: int
    data: bytes


@dataclass(frozen=True, kw_only=True)
class Summary:
    """What a file holds: messages by topic, first and last log time (ns, 0 without messages), chunks."""

    library: str
    message_count: int
    channel_counts: dict[str, int]
    start_time: int
    end_time: int
    chunks: int


class Record(NamedTuple):
    """Where a record is: from the byte of its opcode to the byte after it."""

    opcode: int
    start: int
    end: int


class Chunk(NamedTuple):
    """What a chunk says of its data, and where that is. Times: first and last log time, ns."""

    start_time: int
    end_time: int
    compression: str
    size: int
    crc: int
    data_start: int
    data_end: int


class Declarations:
    """The schemas and channels met so far."""

    def __init__(self) -> None:
        self.channels: dict[int, Channel] = {}
        self._schemas = {0: ("", "", b"")}
        self._known: set[tuple[int, bytes]] = set()

    def add(self, opcode: int, content: bytes) -> None:
        """Take a declaration; ValueError where it is malformed or contradicts an earlier one."""
        if (opcode, content) in self._known:
            return  # Every chunk of a log declares the same.
        if opcode == Opcode.SCHEMA:
            schema = parse_record(records.Schema, content)
            texts = (schema.name, schema.encoding, bytes(schema.data))
            if self._schemas.setdefault(schema.id, texts) != texts:
                raise ValueError(f"schema {schema.id} is declared twice, differently")
        elif opcode == Opcode.CHANNEL:
            read = parse_record(records.Channel, content)
            if read.schema_id not in self._schemas:
                raise ValueError(f"channel {read.id} has no schema {read.schema_id}")
            texts = self._schemas[read.schema_id]
            channel = Channel(read.id, read.topic, read.message_encoding, *texts, read.metadata)
            if self.channels.setdefault(read.id, channel) != channel:
                raise ValueError(f"channel {read.id} is declared twice, differently")
        self._known.add((opcode, content))


class Closing:
    """What the summary section says; ValueError where it is malformed, or lacks a part that is optional."""

    def __init__(self, section: bytes) -> None:
        self.declared = Declarations()
        self.extras: list[Record] = []
        self.chunks = 0
        said: records.Statistics | None = None
        position = 0
        while position < len(section):
            opcode, length = RECORD.unpack_from(section, position)
            position += RECORD.size + length
            content = section[position - length : position]
            if opcode == Opcode.CHUNK_INDEX:
                self.chunks += 1
            elif opcode in (Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX):
                kind = Opcode.ATTACHMENT if opcode == Opcode.ATTACHMENT_INDEX else Opcode.METADATA
                start, size = struct.unpack_from("<QQ", content)
                self.extras.append(Record(kind, start, start + size))
            elif opcode == Opcode.STATISTICS:
                said = parse_record(records.Statistics, content)
            else:
                self.declared.add(opcode, content)
        there = self.chunks, len(self.extras)
        if said is None or there != (said.chunk_count, said.attachment_count + said.metadata_count):
            raise ValueError("the summary is not whole")
        self.statistics = said


def parse_record(parser: type[Parsed], content: bytes) -> Parsed:
    """Read a record's content with the public library; ValueError where it is malformed."""
    builder = RecordBuilder()
    try:
        record: Parsed = parser.read(ReadDataStream(BytesIO(content)))
        record.write(builder)
    except (McapError, struct.error, OverflowError, MemoryError) as error:
        raise ValueError(f"it is malformed ({error})" if str(error) else "it is malformed") from None
    # The library accepts fields that are too short: the record that it writes back differs then.
    written: bytes = builder.end()[RECORD.size :]
    if parser is records.Attachment and content.endswith(NO_CRC):
        written = written[: -len(NO_CRC)] + NO_CRC
    if written != content:
        raise ValueError("it is malformed, or its CRC is wrong")
    return record


def decompress(data: bytes, chunk: Chunk) -> bytes:
    """Return a chunk's records; ValueError or the library's own error where they are not what it says."""
    if chunk.compression == "":
        records_data = data
    elif chunk.size > MAX_CHUNK_BYTES or chunk.size > max(_BOMB_BYTES, _BOMB_RATIO * len(data)):
        raise ValueError(f"it claims to hold {chunk.size} bytes")
    elif chunk.compression == "zstd":
        if zstandard.frame_content_size(data) not in (-1, chunk.size):
            raise ValueError("its size is not what it says")
        records_data = zstandard.ZstdDecompressor().decompress(data, max_output_size=chunk.size)
    elif chunk.compression == "lz4":
        records_data = _lz4_decompressor()(data, max_length=chunk.size)
    else:
        raise ValueError(f"its compression {chunk.compression!r} is unknown")
    if len(records_data) != chunk.size:
        raise ValueError("its size is not what it says")
    return records_data


def messages_in(
    data: bytes | mmap.mmap, part: Record, declared: Declarations, report: Callable[[str], None]
) -> list[RawMessage]:
    """Take the declarations and messages of a part of the data, up to a record that is cut; report what is wrong."""
    found: list[RawMessage] = []
    # Every reader of logs spends its time here: tuple.__new__ takes half as long as the class's own constructor.
    new, unpack, channels = tuple.__new__, _WHOLE_MESSAGE.unpack_from, declared.channels
    _, position, end = part
    last_head = end - _WHOLE_MESSAGE.size
    while position + RECORD.size <= end:
        try:
            if data[position] == _MESSAGE_OPCODE and position <= last_head:
                _, length, channel, sequence, log_time, publish_time = unpack(data, position)
                start, position = position + _WHOLE_MESSAGE.size, position + RECORD.size + length
                if start <= position <= end and length <= MAX_RECORD_BYTES:
                    content = data[start:position]
                    found.append(new(RawMessage, (channels[channel], log_time, publish_time, sequence, content)))
                    continue
            else:
                opcode, length = RECORD.unpack_from(data, position)
                start, position = position + RECORD.size, position + RECORD.size + length
                if position <= end and opcode != _MESSAGE_OPCODE and length <= MAX_RECORD_BYTES:
                    declared.add(opcode, data[start:position])
                    continue
        except KeyError as error:
            report(f"channel {error} has messages and is not declared")
            continue
        except (ValueError, struct.error) as error:
            report(f"a declaration is damaged: {error}")
            continue
        if position > end:
            break
        report("a message is shorter than its fields, or a record larger than any")
    if position != end:
        report("a chunk ends inside a record")
    return found


def _lz4_decompressor() -> Callable[..., bytes]:
    decompress: Callable[..., bytes] = (
        from_extra("lz4.frame", "a log compressed with lz4").LZ4FrameDecompressor().decompress
    )
    return decompress
