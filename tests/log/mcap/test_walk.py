"""What the walk through a file takes for a record, and what a reader says of a file that it cannot walk through."""

from __future__ import annotations

import os
import resource
import struct
from pathlib import Path

import pytest

from tests.log.mcap.made import altered, rows
from zenoh_cbef.log.mcap import contents
from zenoh_cbef.log.mcap import writer as writing
from zenoh_cbef.log.mcap.contents import RECORD, Chunk, Declarations, NotMcapError, Record
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.walk import RecordWalk
from zenoh_cbef.log.mcap.writer import MAGIC, McapWriter


def sound(path: Path) -> bytes:
    with McapWriter(path, library="test") as writer:
        writer.add_message(writer.register_channel("a", "msgpack", 0), 1, 2, 3, b"x")
        writer.flush()
        return path.read_bytes()[: writer.bytes_written]


def test_a_record_of_an_unknown_kind_and_no_content_is_named_and_passed_over(tmp_path: Path) -> None:
    begin = sound(tmp_path / "log.mcap")
    file = altered(begin + RECORD.pack(0x80, 0) + begin[len(MAGIC) + begin[len(MAGIC) + 1] + RECORD.size :])
    assert rows(file) == [("a", 1, 2, 3, b"x")] * 2
    assert f"record at byte {len(begin)} is of the unexpected kind 128" in file.damage


@pytest.mark.parametrize(("more", "found"), [(0, True), (-1, False), (1, False)])
def test_a_chunk_may_be_empty(more: int, found: bool) -> None:
    content = struct.pack("<QQQI", 4, 5, 0, 0) + struct.pack("<I", 0) + struct.pack("<Q", 0)
    data = RECORD.pack(6, len(content)) + content + b"\0" * more
    walk = RecordWalk(data, len(data), complete=False, report=[].append)  # type: ignore[arg-type]
    end = RECORD.size + len(content)
    said = Chunk(4, 5, "", 0, 0, end, end)
    assert walk.chunk(Record(6, 0, end + more)) == (said if found else None)


@pytest.mark.parametrize(
    ("begin", "why"), [(b"", "it is empty"), (MAGIC[:-1] + b"x", "it does not begin with the MCAP magic")]
)
def test_what_is_no_mcap_file_is_told_why(tmp_path: Path, begin: bytes, why: str) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(begin)
    with pytest.raises(NotMcapError, match=f"{path} is no MCAP file: {why}$"):
        McapFile(path)


def test_chunks_have_a_mebibyte_where_nothing_else_is_said(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with McapWriter(path, library="test") as writer:
        channel = writer.register_channel("a", "msgpack", 0)
        for number in range(4):
            writer.add_message(channel, number, number, number, bytes(600_000))
    assert McapFile(path).summary().chunks == 2


def test_messages_that_the_disk_has_no_room_for_are_not_counted(tmp_path: Path) -> None:
    most, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with McapWriter(tmp_path / "log.mcap", compression="none", library="test") as writer:
        channel = writer.register_channel("a", "msgpack", 0)
        writer.add_message(channel, 1, 1, 1, b"x")
        writer.flush()
        for number in range(3):
            writer.add_message(channel, number, number, number, bytes(100_000))
        assert writer.message_count == 4
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, hard))
        try:
            with pytest.raises(OSError, match="too large"):
                writer.flush()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
        assert writer.message_count == 1
    assert len(rows(McapFile(tmp_path / "log.mcap"))) == 1


def test_a_file_that_cannot_be_begun_is_left_to_no_process_and_not_at_all(tmp_path: Path) -> None:
    most, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    try:
        with pytest.raises(OSError, match="too large"):
            McapWriter(tmp_path / "log.mcap", library="test")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    open_files = (os.path.realpath(one) for one in Path("/proc/self/fd").iterdir())
    assert not [one for one in open_files if one.startswith(str(tmp_path))]
    assert not list(tmp_path.iterdir())


def test_a_file_goes_to_the_disk_when_that_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    monkeypatch.setattr(writing, "_sync_data", synced.append)
    with McapWriter(tmp_path / "log.mcap", library="test") as writer:
        writer.flush()
        assert synced == []
        writer.flush(sync=True)
        assert len(synced) == 1
    writer.flush(sync=True)
    assert len(synced) == 1


def test_what_was_declared_before_is_not_read_again(monkeypatch: pytest.MonkeyPatch) -> None:
    content = struct.pack("<HH", 7, 0) + struct.pack("<I", 1) + b"a" + bytes(4) + bytes(4)
    declared = Declarations()
    declared.add(4, content)
    monkeypatch.setattr(contents, "parse_record", None)
    declared.add(4, content)
    assert declared.channels[7].topic == "a"
