"""Files that lie about their lengths neither fill the memory nor keep a reader busy."""

from __future__ import annotations

import os
import random
import struct
from pathlib import Path

import pytest
import zstandard
from mcap.writer import Writer

from zenoh_cbef.log.mcap import contents, reader
from zenoh_cbef.log.mcap.contents import MAX_RECORD_BYTES, MESSAGE, RECORD, Channel, Declarations, Record, messages_in
from zenoh_cbef.log.mcap.pile import Pile
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.walk import RecordWalk
from zenoh_cbef.log.mcap.writer import MAGIC, McapWriter


@pytest.fixture
def head(tmp_path):
    """The beginning of a file: magic, header, one message in a chunk."""
    path = tmp_path / "sound.mcap"
    with McapWriter(path, library="test") as writer:
        channel = writer.register_channel("a", "msgpack", writer.register_schema("s", "jsonschema", b"{}"))
        writer.add_message(channel, 1, 1, 0, b"x")
        writer.flush()
        size = writer.bytes_written
    return path.read_bytes()[:size]


def chunk(size: int, data: bytes) -> bytes:
    content = struct.pack("<QQQI", 0, 0, size, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(data)) + data
    return RECORD.pack(6, len(content)) + content


@pytest.mark.parametrize("size", [100 << 20, 1 << 40])
def test_a_chunk_that_is_there_to_fill_the_memory_is_damaged(tmp_path, head, size):
    path = tmp_path / "bomb.mcap"
    path.write_bytes(head + chunk(size, zstandard.compress(bytes(100 << 20))))
    file = McapFile(path)
    assert len(list(file.messages())) == 1
    assert any(f"it claims to hold {size} bytes" in sentence for sentence in file.damage)


def test_a_large_chunk_that_is_no_bomb_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(contents, "_BOMB_BYTES", 1 << 20)
    path = tmp_path / "large.mcap"
    with McapWriter(path, library="test", chunk_bytes=8 << 20) as writer:
        channel = writer.register_channel("a", "msgpack", 0)
        block = random.Random(1).randbytes(1 << 17)  # noqa: S311
        for number in range(10):
            writer.add_message(channel, number, number, number, block)
    assert len(list(McapFile(path).messages())) == 10


def test_a_hole_is_passed_over_at_once(tmp_path, head):
    path = tmp_path / "hole.mcap"
    path.write_bytes(head)
    with path.open("r+b") as stream:
        stream.truncate(64 << 20)
    file = McapFile(path)
    assert len(list(file.messages())) == 1
    assert file.damage
    # Record by record, the hole would be seven million of kind 0.
    assert len(file.damage) < 5


def test_a_record_that_claims_more_than_any_has_is_damaged(tmp_path, head):
    path = tmp_path / "attachment.mcap"
    path.write_bytes(head + RECORD.pack(9, MAX_RECORD_BYTES + 1))
    with path.open("r+b") as stream:
        stream.truncate(len(head) + RECORD.size + MAX_RECORD_BYTES + 1)
    file = McapFile(path)
    assert file.attachments == {}
    assert any("claims to be" in sentence for sentence in file.damage)


def test_a_file_of_nothing_but_its_magic_is_read(tmp_path):
    (tmp_path / "magic.mcap").write_bytes(MAGIC)
    file = McapFile(tmp_path / "magic.mcap")
    assert list(file.messages()) == []
    summary = file.summary()
    assert (summary.message_count, summary.start_time, summary.end_time, summary.chunks) == (0, 0, 0, 0)


def parts(data: bytes) -> tuple[list[bytes], list[str]]:
    """What the records of a chunk hold for a reader that knows channel 1, and what it reports."""
    declared, told = Declarations(), list[str]()
    declared.channels[1] = Channel(1, "a", "", "", "", b"", {})
    part = Record(0, 0, len(data))
    return [message.data for message in messages_in(data, part, declared, told.append)], told


def test_messages_that_are_shorter_than_their_fields_are_told_and_those_after_them_read():
    whole = RECORD.pack(5, MESSAGE.size + 1) + MESSAGE.pack(1, 0, 0, 0) + b"x"
    short = RECORD.pack(5, MESSAGE.size - 1) + MESSAGE.pack(1, 0, 0, 0)[:-1]
    assert parts(whole + whole) == ([b"x", b"x"], [])
    assert parts(short + whole) == ([b"x"], ["a message is shorter than its fields, or a record larger than any"])
    assert parts(whole + short) == ([b"x"], ["a message is shorter than its fields, or a record larger than any"])
    assert parts(whole + whole[:-1]) == ([b"x"], ["a chunk ends inside a record"])


@pytest.mark.parametrize("size", [RECORD.size, 20, 52])
def test_a_chunk_whose_head_is_cut_is_none(size):
    walk = RecordWalk(chunk(1, b"x")[:size], size, complete=False, report=[].append)  # type: ignore[arg-type]
    assert walk.chunk(Record(6, 0, 1000)) is None


@pytest.mark.parametrize("sizes", [(1 << 16,), ((1 << 16) - 1,), (70_000, 70_000, 3), ()])
def test_a_pile_gives_back_what_was_put_on_it_and_keeps_little_in_memory(tmp_path, sizes):
    pile, records = Pile(tmp_path), [random.Random(size).randbytes(size) for size in sizes]  # noqa: S311
    for record in records:
        pile.add(record)
    assert pile.read() == b"".join(records)
    assert pile.in_memory == sum(size for size in sizes if size < 1 << 16)
    assert list(tmp_path.iterdir()) == []
    pile.close()


def test_a_declaration_that_is_damaged_is_told_and_what_follows_is_read():
    whole = RECORD.pack(5, MESSAGE.size + 1) + MESSAGE.pack(1, 0, 0, 0) + b"x"
    data, told = parts(RECORD.pack(4, 3) + b"abc" + whole)
    assert data == [b"x"]
    assert len(told) == 1
    assert told[0].startswith("a declaration is damaged: ")


def test_a_message_among_chunks_is_told_and_left_out(tmp_path, head):
    path = tmp_path / "among.mcap"
    path.write_bytes(head + RECORD.pack(5, MESSAGE.size + 1) + MESSAGE.pack(1, 1, 1, 1) + b"y")
    file = McapFile(path)
    assert [message.data for message in file.messages()] == [b"x"]
    assert file.lost == [f"message at byte {len(head)} stands among chunks"]


def test_a_summary_may_be_as_long_as_a_record_and_no_longer(tmp_path, head, monkeypatch):
    path = tmp_path / "sound.mcap"
    data = path.read_bytes()
    start = int.from_bytes(data[-28:-20], "little")  # The footer: two places, a CRC; then the magic.
    size = len(data) - len(MAGIC) - 29 - start
    assert len(head) + RECORD.size + 4 == start
    for longest, damage in ((size, []), (size - 1, [f"the summary claims to be {size} bytes long"])):
        monkeypatch.setattr(reader, "MAX_RECORD_BYTES", longest)
        file = McapFile(path)
        assert [message.data for message in file.messages()] == [b"x"]
        assert file.damage[:1] == damage


@pytest.mark.parametrize("most", [1, 2])
def test_so_many_faults_are_told_each_once_and_no_more(tmp_path, head, monkeypatch, most):
    path = tmp_path / "faults.mcap"
    stray = RECORD.pack(5, MESSAGE.size) + MESSAGE.pack(1, 1, 1, 1)
    path.write_bytes(head + 3 * stray)
    monkeypatch.setattr(reader, "MAX_DAMAGE", most)
    file = McapFile(path)
    for _ in range(2):
        assert len(list(file.messages())) == 1
    places = [len(head) + number * len(stray) for number in range(most)]
    assert file.lost == [f"message at byte {place} stands among chunks" for place in places]


def two_attachments(path: Path) -> tuple[int, bytearray]:
    """Write a file with two attachments; where the first one begins, and the file's bytes."""
    with McapWriter(path, library="test") as writer:
        start = writer.bytes_written
        writer.add_attachment("first", "text/plain", b"1")
        writer.add_attachment("second", "text/plain", b"2")
    return start, bytearray(path.read_bytes())


def test_an_attachment_that_is_not_where_its_index_says_is_told(tmp_path):
    path = tmp_path / "moved.mcap"
    start, data = two_attachments(path)
    data[start] = 0x90
    path.write_bytes(data)
    file = McapFile(path)
    assert file.attachments == {"second": b"2"}
    assert file.lost == [f"attachment at byte {start} is not where it should be"]


def test_an_attachment_that_cannot_be_read_is_told(tmp_path):
    path = tmp_path / "bent.mcap"
    start, data = two_attachments(path)
    data[data.index(b"first")] = 0xFF  # no UTF-8
    path.write_bytes(data)
    file = McapFile(path)
    assert file.attachments == {"second": b"2"}
    assert len(file.lost) == 1
    assert file.lost[0].startswith(f"attachment at byte {start} is damaged: ")


@pytest.mark.usefixtures("head")
def test_a_data_section_without_its_closing_record_is_told_as_is_what_stands_in_its_place(tmp_path, head):
    path = tmp_path / "sound.mcap"
    data = bytearray(path.read_bytes())
    start = data.index(RECORD.pack(0x0F, 4), len(head))
    data[start] = 0x80
    path.write_bytes(data)
    file = McapFile(path)
    assert [message.data for message in file.messages()] == [b"x"]
    assert file.damage == [
        f"record at byte {start} is of the unexpected kind 128",
        f"the data section ends at byte {start + RECORD.size + 4} without its closing record",
    ]


def test_of_a_message_outside_of_chunks_that_is_cut_nothing_is_read(tmp_path):
    path, ends = tmp_path / "bare.mcap", []
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start("", "other")
        channel = writer.register_channel("key", "", 0)
        for number in range(4):
            writer.add_message(channel, number, b"data", number, number)
            ends.append(stream.tell())
        writer.finish()
    data = path.read_bytes()
    for cut in range(ends[0], ends[-1]):
        path.write_bytes(data[:cut])
        file = McapFile(path)
        assert not file.closed
        assert [message.data for message in file.messages()] == [b"data"] * sum(end <= cut for end in ends)
        assert not file.closed
        assert len(file.lost) == (cut not in ends)


@pytest.mark.usefixtures("head")
def test_a_file_that_ended_as_its_writer_ended_it_is_closed(tmp_path):
    file = McapFile(tmp_path / "sound.mcap")
    assert not file.closed
    assert len(list(file.messages())) == 1
    assert file.closed


def test_a_pile_whose_file_was_emptied_says_so(tmp_path):
    pile = Pile(tmp_path)
    pile.add(bytes(1 << 16))
    assert pile._file is not None  # noqa: SLF001 - no path leads there
    os.ftruncate(pile._file, 0)  # noqa: SLF001
    with pytest.raises(OSError, match="is gone"):
        pile.read()
    pile.close()
