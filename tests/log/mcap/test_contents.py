"""What a reader takes for a record, a declaration and a chunk's data, and up to which size."""

from __future__ import annotations

import random
import struct
from typing import Any

import pytest
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder

from zenoh_cbef.log.mcap import contents
from zenoh_cbef.log.mcap.contents import MESSAGE, RECORD, Channel, Chunk, Declarations, Record, decompress, messages_in

CLAIMS, DIFFERS = "it claims to hold", "its size is not what it says"


def chunk(size: int, compression: str = "zstd") -> Chunk:
    return Chunk(0, 0, compression, size, 0, 0, 0)


@pytest.mark.parametrize(
    ("length", "most"),
    [
        (14, 64 << 20),  # However well it is compressed, up to 64 MiB,
        (400_000, 80_000_000),  # beyond that up to 200 times as much,
        (3_000_000, 512 << 20),  # and never more than 512 MiB.
    ],
)
def test_a_chunk_may_claim_so_much_and_no_more(length: int, most: int) -> None:
    data = zstandard.compress(random.Random(1).randbytes(length))[:length]  # noqa: S311
    with pytest.raises(ValueError, match=DIFFERS):
        decompress(data, chunk(most))
    with pytest.raises(ValueError, match=CLAIMS):
        decompress(data, chunk(most + 1))


def test_data_of_another_size_than_the_chunk_says_is_no_data() -> None:
    assert decompress(b"abc", chunk(3, "")) == b"abc"
    with pytest.raises(ValueError, match=DIFFERS):
        decompress(b"abc", chunk(4, ""))
    packed = zstandard.compress(b"abc" * 9)
    assert decompress(packed, chunk(27)) == b"abc" * 9
    for size in (26, 28):
        with pytest.raises(ValueError, match=DIFFERS):
            decompress(packed, chunk(size))
    with pytest.raises(ValueError, match="'rle' is unknown"):
        decompress(b"abc", chunk(3, "rle"))


def test_a_frame_need_not_say_how_much_it_holds() -> None:
    silent = zstandard.ZstdCompressor(write_content_size=False).compress(b"abc" * 9)
    assert decompress(silent, chunk(27)) == b"abc" * 9
    with pytest.raises(ValueError, match=DIFFERS):
        decompress(silent, chunk(28))


def written(record: Any) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end()[RECORD.size :])


def schema(name: str, number: int = 1) -> bytes:
    return written(records.Schema(data=b"{}", encoding="jsonschema", id=number, name=name))


def channel(topic: str, schema_id: int = 1) -> bytes:
    return written(records.Channel(id=7, topic=topic, message_encoding="json", metadata={}, schema_id=schema_id))


def test_a_declaration_may_be_repeated_and_not_contradicted() -> None:
    declared = Declarations()
    for _ in range(2):
        declared.add(3, schema("Beacon"))
        declared.add(4, channel("key"))
    assert declared.channels == {7: Channel(7, "key", "json", "Beacon", "jsonschema", b"{}", {})}
    with pytest.raises(ValueError, match="schema 1 is declared twice"):
        declared.add(3, schema("Range"))
    with pytest.raises(ValueError, match="channel 7 is declared twice"):
        declared.add(4, channel("other"))
    with pytest.raises(ValueError, match="channel 7 has no schema 2"):
        declared.add(4, channel("key", 2))
    declared.add(3, schema("Range", 2))
    assert declared.channels[7].topic == "key"


def test_a_channel_may_have_no_schema() -> None:
    declared = Declarations()
    declared.add(4, channel("key", 0))
    assert declared.channels[7].schema_name == ""


@pytest.mark.parametrize(("longest", "found"), [(23, 1), (22, 0)])
def test_a_message_may_be_as_long_as_any_record_and_no_longer(
    monkeypatch: pytest.MonkeyPatch, longest: int, found: int
) -> None:
    declared, told = Declarations(), list[str]()
    declared.channels[1] = Channel(1, "a", "", "", "", b"", {})
    data = RECORD.pack(5, 23) + MESSAGE.pack(1, 2, 3, 4) + b"x"
    monkeypatch.setattr(contents, "MAX_RECORD_BYTES", longest)
    messages = messages_in(data, Record(6, 0, len(data)), declared, told.append)
    assert [message[1:] for message in messages] == [(3, 4, 2, b"x")] * found
    assert len(told) == 1 - found


@pytest.mark.parametrize("more", [0, 1])
def test_a_declaration_may_be_as_long_as_any_record_and_no_longer(monkeypatch: pytest.MonkeyPatch, more: int) -> None:
    declared, told, content = Declarations(), list[str](), channel("key", 0)
    data = RECORD.pack(4, len(content)) + content
    monkeypatch.setattr(contents, "MAX_RECORD_BYTES", len(content) - more)
    assert messages_in(data, Record(6, 0, len(data)), declared, told.append) == []
    assert (len(declared.channels), len(told)) == (1 - more, more)


def test_a_message_of_a_channel_that_was_not_declared_is_told_and_what_follows_is_read() -> None:
    declared, told = Declarations(), list[str]()
    declared.channels[1] = Channel(1, "a", "", "", "", b"", {})
    unknown, known = (RECORD.pack(5, MESSAGE.size) + MESSAGE.pack(number, 0, 0, 0) for number in (9, 1))
    data = unknown + known
    assert len(messages_in(data, Record(6, 0, len(data)), declared, told.append)) == 1
    assert told == ["channel 9 has messages and is not declared"]


def test_part_of_the_data_is_read_from_where_it_begins() -> None:
    declared, told = Declarations(), list[str]()
    declared.channels[1] = Channel(1, "a", "", "", "", b"", {})
    data = b"before" + RECORD.pack(5, MESSAGE.size) + MESSAGE.pack(1, 8, 0, 0) + struct.pack("<B", 0)
    assert messages_in(data, Record(6, 6, len(data) - 1), declared, told.append)[0].sequence == 8
    assert told == []
