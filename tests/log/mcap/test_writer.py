"""What the writer writes is read back, exactly, by the public library with its CRC checks on."""

from __future__ import annotations

import os
import resource
import signal
import stat
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, make_reader

from zenoh_cbef.log.mcap import writer as writing
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.writer import Compression, McapWriter, _next_number

COMPRESSIONS: tuple[Compression, ...] = ("zstd", "lz4", "none")
TIMES = st.integers(0, 2**64 - 1)
MESSAGES = st.lists(
    st.tuples(st.integers(0, 2), TIMES, TIMES, st.integers(0, 2**40), st.binary(max_size=60)), max_size=40
)


def write(path: Path, messages: list[tuple[int, int, int, int, bytes]], **settings: Any) -> None:
    with McapWriter(path, library="test 1.0", **settings) as writer:
        schema = writer.register_schema("Beacon", "jsonschema", b'{"type": "object"}')
        channels = [
            writer.register_channel("cbef/run/a1/beacon", "msgpack", schema, {"agent": "a1"}),
            writer.register_channel("cbef/run/a2/beacon", "msgpack", schema),
            writer.register_channel("foreign/\N{SNOWMAN}", "", 0),
        ]
        writer.add_attachment("scenario.toml", "application/toml", b"seed = 1\n", log_time=7)
        writer.add_metadata("cbef.run", {"seed": "1", "host": "b\N{LATIN SMALL LETTER O WITH DIAERESIS}"})
        for channel, logged, published, sequence, data in messages:
            writer.add_message(channels[channel], logged, published, sequence, data)


@settings(max_examples=60, deadline=None)
@given(MESSAGES, st.sampled_from(COMPRESSIONS), st.sampled_from([1, 300, 1 << 20]))
def test_the_official_reader_reads_every_message_exactly(
    messages: list[tuple[int, int, int, int, bytes]], compression: Compression, chunk_bytes: int
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        write(path, messages, compression=compression, chunk_bytes=chunk_bytes)
        wanted = [(c + 1, log, sent, n & 0xFFFFFFFF, data) for c, log, sent, n, data in messages]
        with path.open("rb") as stream:
            read = NonSeekingReader(stream, validate_crcs=True).iter_messages(log_time_order=False)
            found = [(m.channel_id, m.log_time, m.publish_time, m.sequence, m.data) for _, _, m in read]
        assert found == wanted
        with path.open("rb") as stream:
            summary = make_reader(stream, validate_crcs=True).get_summary()
        assert summary is not None
        statistics = summary.statistics
        assert statistics is not None
        assert statistics.message_count == len(messages)
        assert statistics.message_start_time == min((m[1] for m in messages), default=0)
        assert statistics.message_end_time == max((m[1] for m in messages), default=0)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_the_official_reader_finds_summary_attachments_and_metadata(tmp_path: Path, compression: Compression) -> None:
    path = tmp_path / "log.mcap"
    messages = [(n % 2, 10 + n, n, n, b"x" * n) for n in range(100)]
    write(path, messages, compression=compression, chunk_bytes=1000)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert reader.get_header().library == "test 1.0"
        attachments = [(a.name, a.media_type, a.data, a.log_time) for a in reader.iter_attachments()]
        metadata = [(m.name, m.metadata) for m in reader.iter_metadata()]
        late = [m.sequence for _, _, m in reader.iter_messages(topics=["cbef/run/a2/beacon"], starting_at=100)]
    assert attachments == [("scenario.toml", "application/toml", b"seed = 1\n", 7)]
    assert metadata == [("cbef.run", {"seed": "1", "host": "b\xf6"})]
    assert late == list(range(91, 100, 2))
    assert summary is not None
    schema, channel = summary.schemas[1], summary.channels[1]
    assert (schema.name, schema.encoding, schema.data) == ("Beacon", "jsonschema", b'{"type": "object"}')
    assert (channel.topic, channel.metadata, channel.schema_id) == ("cbef/run/a1/beacon", {"agent": "a1"}, 1)
    assert summary.channels[3].schema_id == 0
    counts = summary.statistics
    assert counts is not None
    assert counts.channel_message_counts == {1: 50, 2: 50}
    assert (counts.schema_count, counts.channel_count, counts.attachment_count) == (1, 3, 1)
    assert counts.metadata_count == 1
    assert counts.chunk_count == len(summary.chunk_indexes) > 2
    # Readers find what follows a chunk, the indexes of its messages, by the lengths that its own index says.
    data = path.read_bytes()
    for chunk in summary.chunk_indexes:
        at = chunk.chunk_start_offset + chunk.chunk_length
        until = at + chunk.message_index_length
        while at < until:
            assert data[at] == Opcode.MESSAGE_INDEX
            at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
        assert at == until
        assert data[at] != Opcode.MESSAGE_INDEX


def test_what_is_flushed_is_readable_while_the_file_is_open(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    writer = McapWriter(path, library="test")
    channel = writer.register_channel("key", "msgpack", 0)
    for n in range(5):
        writer.add_message(channel, n, n, n, b"data")
        writer.flush(sync=n % 2 == 0)
        assert [m.sequence for m in McapFile(path).messages()] == list(range(n + 1))
        assert writer.bytes_written == path.stat().st_size
    writer.close()
    writer.close()
    assert writer.message_count == 5
    assert writer.bytes_written == path.stat().st_size


def test_messages_that_cannot_be_written_are_refused_and_leave_no_trace(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with McapWriter(path, library="test") as writer:
        channel = writer.register_channel("key", "", 0)
        with pytest.raises(ValueError, match="no channel 9"):
            writer.add_message(9, 0, 0, 0, b"")
        with pytest.raises(ValueError, match="no schema 4"):
            writer.register_channel("key", "", 4)
        with pytest.raises(struct.error):
            writer.add_message(channel, -1, 0, 0, b"")
        with pytest.raises(TypeError):
            writer.add_message(channel, 0, 0, 0, "text")  # type: ignore[arg-type]
        writer.add_message(channel, 1, 2, -1, b"good")
    with pytest.raises(ValueError, match="closed"):
        writer.add_message(channel, 0, 0, 0, b"")
    file = McapFile(path)
    assert [message[1:] for message in file.messages()] == [(1, 2, 0xFFFFFFFF, b"good")]
    assert file.damage == []


def test_a_chunk_ends_with_the_message_that_begins_where_it_is_full(tmp_path: Path) -> None:
    declared = 9 + 2 + 2 + 4 + len("key") + 4 + 4  # record, numbers, topic, encoding and metadata
    message = 9 + 2 + 4 + 8 + 8 + 10
    for size, chunks in ((declared + 3 * message, 2), (declared + 3 * message + 1, 1)):
        path = tmp_path / f"{size}.mcap"
        with McapWriter(path, chunk_bytes=size, library="test") as writer:
            channel = writer.register_channel("key", "", 0)
            for n in range(5):
                writer.add_message(channel, n, n, n, bytes(10))
        assert McapFile(path).summary().chunks == chunks


def test_an_attachment_of_an_unknown_time_has_none(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with McapWriter(path, library="test") as writer:
        writer.add_attachment("note", "text/plain", b"text")
    with path.open("rb") as stream:
        found = make_reader(stream, validate_crcs=True)
        [attachment] = found.iter_attachments()
        summary = found.get_summary()
    assert (attachment.log_time, attachment.create_time) == (0, 0)
    assert summary is not None
    [index] = summary.attachment_indexes
    assert (index.log_time, index.create_time, index.data_size) == (0, 0, 4)


def test_a_file_that_is_closed_may_be_flushed(tmp_path: Path) -> None:
    with McapWriter(tmp_path / "log.mcap", library="test") as writer:
        pass
    writer.flush(sync=True)


def test_numbers_of_schemas_and_channels_fit_into_sixteen_bits() -> None:
    assert _next_number(0xFFFF, "channels") == 0xFFFF
    with pytest.raises(ValueError, match="at most 65535 channels"):
        _next_number(0x10000, "channels")


KILLED = """
import sys
from pathlib import Path
from zenoh_cbef.log.mcap.writer import McapWriter
writer = McapWriter(Path(sys.argv[1]), library="test")
channel = writer.register_channel("key", "msgpack", 0)
n = 0
while True:
    for _ in range(100):
        writer.add_message(channel, n, n, n, b"%d" % n * 30)
        n += 1
    writer.flush()
    print(n, flush=True)
"""


@pytest.mark.processes
@pytest.mark.parametrize("rounds", [1, 7, 50])
def test_kill_9_keeps_what_was_flushed(tmp_path: Path, rounds: int) -> None:
    path = tmp_path / "log.mcap"
    command = [sys.executable, "-c", KILLED, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        flushed = [int(process.stdout.readline()) for _ in range(rounds)][-1]
        process.send_signal(signal.SIGKILL)
    messages = list(McapFile(path).messages())
    assert len(messages) >= flushed
    assert all(m.sequence == n and m.data == b"%d" % n * 30 for n, m in enumerate(messages))


FULL = """
import os, sys
from pathlib import Path
from zenoh_cbef.log.mcap.writer import McapWriter
writer = McapWriter(Path(sys.argv[1]), compression="none", chunk_bytes=10_000, library="test")
channel = writer.register_channel("key", "msgpack", 0)
kept = 0
try:
    for n in range(10_000):
        writer.add_message(channel, n, n, n, os.urandom(200))
except OSError as error:
    print(writer.message_count, writer.bytes_written)
writer.add_attachment("small", "text/plain", b"still written")
writer.add_message(channel, 0, 0, 77, b"after")
writer.close()
"""


@pytest.mark.processes
def test_a_full_disk_is_an_error_and_the_file_stays_readable(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    limit = 104_000

    def limit_size() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    done = subprocess.run(
        [sys.executable, "-c", FULL, str(path)],
        preexec_fn=limit_size,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    kept, size = (int(word) for word in done.stdout.split())
    assert 300 < kept < 500
    assert size < limit
    file = McapFile(path)
    assert [m.sequence for m in file.messages()] == [*range(kept), 77]
    assert file.attachments == {"small": b"still written"}
    assert file.complete
    assert file.damage == []


def test_a_file_that_is_removed_is_gone_also_after_it_was_closed(tmp_path):
    for removed in (False, True):
        path = tmp_path / f"{removed}.mcap"
        writer = McapWriter(path, library="test")
        assert not writer.gone
        if removed:
            path.unlink()
        assert writer.gone is removed
        writer.close()
        assert writer.gone is removed


def test_a_log_may_be_read_by_whom_the_umask_lets_and_run_by_none(tmp_path: Path) -> None:
    os.umask(masked := os.umask(0))
    McapWriter(tmp_path / "log.mcap", library="test").close()
    assert stat.S_IMODE((tmp_path / "log.mcap").stat().st_mode) == 0o666 & ~masked


def test_a_flush_that_is_to_reach_the_disk_syncs_what_it_has_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[int] = []
    monkeypatch.setattr(writing, "_sync_data", lambda file: synced.append(os.fstat(file).st_size))
    with McapWriter(tmp_path / "log.mcap", library="test") as writer:
        channel = writer.register_channel("a", "", 0)
        for sync in (False, True):
            writer.add_message(channel, 1, 1, 1, b"x" * 1000)
            writer.flush(sync=sync)
        assert synced == [writer.bytes_written]
