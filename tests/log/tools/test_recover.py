"""What is recovered of a damaged log is exactly what was in it."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from tests.examples import examples
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.writer import MAGIC, Compression, McapWriter
from zenoh_cbef.log.tools.recover import Recovered, recover


def rows(path: Path) -> list[tuple[Any, ...]]:
    return [(m.channel.topic, m.channel.schema_name, m.channel.schema_data, *m[1:]) for m in McapFile(path).messages()]


COMPRESSIONS: tuple[Compression, ...] = ("zstd", "lz4", "none")
TIMES = st.integers(0, 2**62)


MESSAGES = st.lists(
    st.tuples(st.integers(0, 3), TIMES, TIMES, st.integers(0, 2**32 - 1), st.binary(max_size=80)), max_size=60
)


EXTRAS = {"scenario": b"seed = 1"}, {"run": {"seed": "1"}, "end": {"status": "done"}}


def written(path: Path, messages: list[tuple[int, int, int, int, bytes]], compression: Compression, chunk: int) -> None:
    with McapWriter(path, compression=compression, chunk_bytes=chunk, library="test") as writer:
        schema = writer.register_schema("Any", "jsonschema", b"{}")
        channels = [writer.register_channel(f"key/{n}", "msgpack", schema, {"n": str(n)}) for n in range(4)]
        writer.add_attachment("scenario", "text/plain", b"seed = 1")
        writer.add_metadata("run", {"seed": "1"})
        for channel, logged, published, sequence, data in messages:
            writer.add_message(channels[channel], logged, published, sequence, data)
        writer.add_metadata("end", {"status": "done"})


def recovered(data: bytes | bytearray, folder: Path) -> tuple[Recovered, Path]:
    damaged, new = folder / "damaged.mcap", folder / "new.mcap"
    damaged.write_bytes(data)
    new.unlink(missing_ok=True)
    found = recover(damaged, new)
    assert damaged.read_bytes() == data
    assert new.exists() == (found.exit_status != 1)
    return found, new


def official(path: Path) -> list[tuple[Any, ...]]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        messages = reader.iter_messages(log_time_order=False)
        read = [(c.topic, m.log_time, m.publish_time, m.sequence, m.data) for _, c, m in messages]
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(read)
    return read


@examples(50)
@given(MESSAGES, st.sampled_from(COMPRESSIONS), st.sampled_from([1, 200, 1 << 20]), st.floats(0, 1))
def test_what_is_recovered_of_a_cut_log_is_an_exact_prefix(
    messages: list[tuple[int, int, int, int, bytes]], compression: Compression, chunk: int, cut: float
) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written(folder / "whole.mcap", messages, compression, chunk)
        data, wanted = (folder / "whole.mcap").read_bytes(), rows(folder / "whole.mcap")
        found, new = recovered(data[: round(cut * len(data))], folder)
        if found.exit_status == 1:
            assert found.lost
            return
        kept = rows(new)
        assert kept == wanted[: len(kept)]
        assert found.messages == len(kept)
        assert [(row[0], *row[3:]) for row in kept] == official(new)
        if found.exit_status == 0:
            assert len(kept) == len(wanted)
            assert (McapFile(new).attachments, McapFile(new).metadata) == EXTRAS
        assert McapFile(new).damage == []


@examples(80)
@given(MESSAGES, st.sampled_from(COMPRESSIONS), st.sampled_from([1, 200, 1 << 20]), st.randoms(use_true_random=False))
def test_a_flipped_bit_never_gives_a_wrong_message_and_never_goes_unsaid(
    messages: list[tuple[int, int, int, int, bytes]], compression: Compression, chunk: int, noise: random.Random
) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written(folder / "whole.mcap", messages, compression, chunk)
        data, wanted = bytearray((folder / "whole.mcap").read_bytes()), rows(folder / "whole.mcap")
        data[noise.randrange(len(data))] ^= 1 << noise.randrange(8)
        found, new = recovered(data, folder)
        if found.exit_status == 1:
            assert found.lost
            return
        kept = rows(new)
        rest = iter(wanted)
        assert all(any(row == other for other in rest) for row in kept)
        same = kept == wanted and (McapFile(new).attachments, McapFile(new).metadata) == EXTRAS
        assert same or found.exit_status == 3


def test_an_undamaged_log_loses_nothing_and_a_recovered_one_is_never_written_over(log: Path, tmp_path: Path) -> None:
    new = tmp_path / "new.mcap"
    assert recover(log, new).exit_status == 0
    assert rows(new) == rows(log)
    assert McapFile(new).attachments == McapFile(log).attachments
    assert McapFile(new).metadata == McapFile(log).metadata
    with pytest.raises(UserError, match="never overwritten"):
        recover(log, new)
    with pytest.raises(UserError, match="never overwritten"):
        recover(log, log)


@pytest.mark.parametrize("content", [b"", b"no log at all", MAGIC])
def test_of_nothing_nothing_is_recovered(tmp_path: Path, content: bytes) -> None:
    found, _ = recovered(content, tmp_path)
    assert found.exit_status == 1
    assert found.lost


@pytest.mark.parametrize("cut", [0, 50])
def test_a_damaged_head_costs_what_stands_in_it_and_no_more(log: Path, tmp_path: Path, cut: int) -> None:
    data = log.read_bytes()
    found, new = recovered(bytes(range(7, 242)) * 3 + data[705 : len(data) - cut], tmp_path)
    assert (found.exit_status, rows(new)) == (3, rows(log))
    assert f"the head of {tmp_path / 'damaged.mcap'} is damaged" in found.lost[0]
    assert McapFile(new).damage == []


def test_a_cut_after_the_data_loses_nothing(log: Path, tmp_path: Path) -> None:
    found, new = recovered(log.read_bytes()[:-50], tmp_path)
    assert (found.exit_status, rows(new)) == (0, rows(log))
