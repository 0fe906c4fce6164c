"""The reader gives what is whole and true in a file, and names what is not."""

from __future__ import annotations

import mmap
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer

from tests.log.mcap.made import MESSAGES, altered, chance, rows
from zenoh_cbef.arrays import Ints
from zenoh_cbef.log.mcap import heads, reader
from zenoh_cbef.log.mcap.contents import Record
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.walk import RecordWalk
from zenoh_cbef.log.mcap.writer import McapWriter

OFFICIAL = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "none": CompressionType.NONE}


def test_a_whole_file_is_read_exactly(log: Path) -> None:
    file = McapFile(log)
    found = list(file.messages())
    assert [m.sequence for m in found] == list(range(MESSAGES))
    first = found[0]
    assert first[1:4] == (1000, 900, 0)
    assert first.data == b"0 " * 10
    assert (first.channel.topic, first.channel.message_encoding) == ("key/0", "msgpack")
    assert (first.channel.schema_name, first.channel.schema_encoding) == ("Beacon", "jsonschema")
    assert first.channel.metadata == {"n": "0"}
    assert found[3].channel is first.channel
    assert file.attachments == {"first": b"seed = 1\n" * 20, "middle": b"middle"}
    assert file.metadata == {"run": {"seed": "1"}, "end": {"status": "done"}}
    assert file.complete
    assert file.damage == []


def test_reading_a_portion_at_once_changes_nothing(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = rows(McapFile(log))
    monkeypatch.setattr(reader, "_AT_ONCE", mmap.PAGESIZE)
    file = McapFile(log)
    assert rows(file) == wanted
    assert file.damage == []
    bent = bytearray(log.read_bytes())
    bent[bent.index(b"middle") + 100] ^= 1
    file = altered(bent)
    list(file.messages())
    assert "the data section fails its CRC" in file.damage


def test_indexes_save_the_walk_through_messages(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted, walked = rows(McapFile(log)), []
    walk = heads.record_places

    def counted(data: bytes, part: Record) -> Ints | None:
        walked.append(walk(data, part))
        return walked[-1]

    monkeypatch.setattr(heads, "record_places", counted)
    assert rows(McapFile(log)) == wanted
    assert all(found is not None for found in walked)
    assert sum(len(found) for found in walked if found is not None) < len(wanted) / 2


@pytest.mark.parametrize("change", [1, 9, -31, 1 << 40, 1 << 63])
@pytest.mark.parametrize("which", [0, 1, -1])
def test_an_index_that_lies_changes_nothing(
    log: Path, monkeypatch: pytest.MonkeyPatch, change: int, which: int
) -> None:
    wanted, sound = rows(McapFile(log)), RecordWalk.entries

    def wrong(self: RecordWalk, chunk: Record) -> bytes:
        found = np.frombuffer(sound(self, chunk), "<u8").copy()
        found[1::2][[which]] += np.uint64(change % (1 << 64))
        return found.tobytes()

    monkeypatch.setattr(RecordWalk, "entries", wrong)
    file = McapFile(log)
    assert rows(file) == wanted
    assert file.damage == []


@pytest.mark.parametrize("kept", [0, 16, 17, 160])
def test_an_index_that_is_not_whole_changes_nothing(log: Path, monkeypatch: pytest.MonkeyPatch, kept: int) -> None:
    wanted, sound = rows(McapFile(log)), RecordWalk.entries
    monkeypatch.setattr(RecordWalk, "entries", lambda self, chunk: sound(self, chunk)[:kept])
    file = McapFile(log)
    assert rows(file) == wanted
    assert file.damage == []


def test_a_message_outside_of_chunks_waits_for_an_earlier_one_whatever_its_other_times(tmp_path: Path) -> None:
    path = tmp_path / "bare.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start("", "other")
        channel = writer.register_channel("key", "", 0)
        for at in (3, 2, 1):
            writer.add_message(channel, at, b"data", (1 << 64) - 1, (1 << 32) - 1)
        writer.finish()
    assert [message.log_time for message in McapFile(path).messages_in_order()] == [1, 2, 3]


def test_messages_come_by_log_time_where_that_is_asked_for(tmp_path: Path) -> None:
    path, noise = tmp_path / "log.mcap", chance(5)
    times = [n + noise.randrange(300) for n in range(2000)]
    with McapWriter(path, chunk_bytes=2000, library="test") as writer:
        channel = writer.register_channel("key", "", 0)
        for n, at in enumerate(times):
            writer.add_message(channel, at, 0, n, b"data")
    found = [(m.log_time, m.sequence) for m in McapFile(path).messages_in_order()]
    assert found == sorted(zip(times, range(2000), strict=True))


def test_messages_outside_of_chunks_come_by_log_time_too(tmp_path: Path) -> None:
    path, times = tmp_path / "bare.mcap", [1 << 40, 3, 1 << 50, 700, 2, 1 << 33, 256]
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start("", "other")
        channel = writer.register_channel("key", "", 0)
        for number, at in enumerate(times):
            writer.add_message(channel, at, b"data", 0, number)
        writer.finish()
    assert [message.log_time for message in McapFile(path).messages_in_order()] == sorted(times)


def test_a_cut_file_is_described_by_its_indexes(log: Path) -> None:
    data = bytearray(log.read_bytes()[:-1])
    middle = data.index(b"middle")
    data[middle + 200 : middle + 210] = bytes(10)  # in a chunk: what is described was not read
    file = altered(data)
    assert file.summary().message_count == MESSAGES
    assert len(list(file.messages())) < MESSAGES


def test_a_whole_file_is_described_by_its_summary_alone(log: Path) -> None:
    data, described = bytearray(log.read_bytes()), McapFile(log).summary()
    hole = data.index(b"middle") + 200  # some chunks and their indexes
    data[hole : hole + 4000] = bytes(4000)
    file = altered(data)
    assert file.summary() == described
    assert len(list(file.messages())) < MESSAGES


def test_what_other_writers_leave_out_is_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "bare.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, index_types=IndexType.NONE, use_statistics=False, use_summary_offsets=False,
                        repeat_channels=False, repeat_schemas=False, enable_crcs=False)  # fmt: skip
        writer.start("", "other")
        channel = writer.register_channel("key", "", 0)
        writer.add_message(channel, 5, b"data", 5)
        writer.add_attachment(1, 1, "note", "text/plain", b"seed = 1")
        writer.finish()
    file = McapFile(path)
    assert [message.data for message in file.messages()] == [b"data"]
    assert file.attachments == {"note": b"seed = 1"}
    assert file.complete
    assert file.damage == []
    assert file.summary().message_count == 1


def test_an_attachment_without_a_crc_is_read_and_one_with_a_wrong_crc_is_not(log: Path) -> None:
    data = bytearray(log.read_bytes())
    end = data.index(b"seed = 1\n" * 20) + 180
    data[end : end + 4] = bytes(4)
    assert altered(data).attachments.keys() == {"first", "middle"}
    data[end : end + 4] = b"\1\0\0\0"
    assert altered(data).attachments.keys() == {"middle"}


def test_the_summary_of_a_cut_file_is_that_of_the_whole(log: Path) -> None:
    whole = McapFile(log).summary()
    assert (whole.library, whole.message_count) == ("test 1.0", MESSAGES)
    assert whole.channel_counts == {f"key/{n}": MESSAGES // 3 for n in range(3)}
    assert (whole.start_time, whole.end_time) == (1000, 999 + MESSAGES)
    assert whole.chunks > 10
    assert altered(log.read_bytes()[:-1]).summary() == whole


def test_the_summary_of_a_cut_file_at_the_beginning_of_time(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with McapWriter(path, library="test") as writer:
        writer.add_message(writer.register_channel("key", "", 0), 0, 0, 0, b"data")
    found = altered(path.read_bytes()[:-1]).summary()
    assert (found.message_count, found.start_time, found.end_time) == (1, 0, 0)


def test_an_attachment_may_be_as_long_as_a_record_and_no_longer(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    size = 9 + 8 + 8 + 4 + 5 + 4 + 10 + 8 + 180 + 4  # of the record with the attachment "first"
    monkeypatch.setattr(reader, "MAX_RECORD_BYTES", size)
    assert McapFile(log).attachments.keys() == {"first", "middle"}
    monkeypatch.setattr(reader, "MAX_RECORD_BYTES", size - 1)
    file = McapFile(log)
    assert file.attachments.keys() == {"middle"}
    assert any(f"claims to be {size} bytes long" in sentence for sentence in file.damage)


def official_files() -> Iterator[dict[str, Any]]:
    for compression in OFFICIAL.values():
        yield {"compression": compression, "chunk_size": 1000}
    yield {"use_chunking": False}
    yield {"enable_crcs": False}
    yield {"enable_data_crcs": True, "chunk_size": 1000}
    yield {"index_types": IndexType.NONE}
    yield {"use_statistics": False, "use_summary_offsets": False}
    yield {"index_types": IndexType.NONE, "use_statistics": False, "repeat_channels": False}


@pytest.mark.parametrize("options", list(official_files()), ids=str)
@pytest.mark.parametrize("cut", [False, True], ids=["whole", "cut"])
def test_files_of_the_official_writer_are_read(tmp_path: Path, options: dict[str, Any], *, cut: bool) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start(library="official")
        schema = writer.register_schema("Beacon", "jsonschema", b"{}")
        channel = writer.register_channel("key", "json", schema, {"a": "b"})
        writer.add_attachment(1, 2, "scenario", "text/plain", b"seed")
        for n in range(200):
            writer.add_message(channel, n, b"%d" % n, n + 1, n + 2)
        writer.add_metadata("end", {"status": "done"})
        writer.finish()
    file = altered(path.read_bytes()[: -1 if cut else None])
    found = list(file.messages())
    assert [m[1:] for m in found] == [(n, n + 1, n + 2, b"%d" % n) for n in range(200)]
    assert found[0].channel.schema_name == "Beacon"
    assert file.attachments == {"scenario": b"seed"}
    assert file.metadata == {"end": {"status": "done"}}
    summary = file.summary()
    assert (summary.library, summary.message_count, summary.channel_counts) == ("official", 200, {"key": 200})
    assert (summary.start_time, summary.end_time) == (0, 199)
    assert file.complete is not cut
    assert len(file.damage) == cut


def test_the_summary_of_a_long_file_does_not_read_its_messages(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with McapWriter(path, compression="none", chunk_bytes=100, library="test") as writer:
        channel = writer.register_channel("key", "", 0)
        for n in range(20_000):
            writer.add_message(channel, n, n, n, bytes(1000))
    begun = time.process_time()
    assert McapFile(path).summary().message_count == 20_000
    assert time.process_time() - begun < 0.5
