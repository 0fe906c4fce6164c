"""Of a damaged file the reader gives what is whole and true, and names what is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import TIMES, examples
from tests.log.mcap.made import MESSAGES, altered, chance, rows
from zenoh_cbef.log.mcap.contents import NotMcapError
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.writer import MAGIC, Compression, McapWriter


def is_subsequence(part: list[Any], whole: list[Any]) -> bool:
    rest = iter(whole)
    return all(any(item == other for other in rest) for item in part)


def test_random_cuts_leave_an_exact_prefix(log: Path) -> None:
    data, wanted = log.read_bytes(), rows(McapFile(log))
    cuts = chance(2)
    for cut in [cuts.randrange(len(MAGIC), len(data)) for _ in range(80 * TIMES)]:
        file = altered(data[:cut])
        found = rows(file)
        assert found == wanted[: len(found)]
        assert not file.complete
        assert file.damage
        assert set(file.attachments.items()) <= {("first", b"seed = 1\n" * 20), ("middle", b"middle")}
        if cut > len(data) - 100:
            assert len(found) == MESSAGES


def test_a_cut_loses_no_complete_chunk_and_no_whole_message_that_is_not_compressed(log: Path) -> None:
    data, wanted = log.read_bytes(), rows(McapFile(log))
    half = len(data) // 2
    found = rows(altered(data[:half]))
    assert MESSAGES // 3 < len(found) < 2 * MESSAGES // 3
    if log.stem == "none":
        last = wanted[len(found)][-1]
        assert last not in data[:half]
        assert found[-1][-1] in data[:half]


@pytest.mark.slow
def test_random_bit_flips_never_crash_and_never_go_unnoticed(log: Path) -> None:
    data, whole = log.read_bytes(), McapFile(log)
    wanted, extras = rows(whole), (whole.attachments, whole.metadata)
    flips = chance(3)
    heads = [n for n in range(len(data)) if data[n] in (4, 5, 6, 7, 9, 12, 15) and data[n + 4 : n + 9] == bytes(5)]
    places = [flips.randrange(len(MAGIC), len(data)) for _ in range(90 * TIMES)]
    for place in places + [flips.choice(heads) + flips.choice((0, 0, 1, 2, 8)) for _ in range(60 * TIMES)]:
        bent = bytearray(data)
        bent[place] ^= 1 << flips.randrange(8)
        file = altered(bent)
        found = rows(file)
        assert is_subsequence(found, wanted), place
        assert file.damage or (found == wanted and (file.attachments, file.metadata) == extras), place


def test_random_bit_flips_in_a_cut_file_never_go_unnoticed(log: Path) -> None:
    data = log.read_bytes()
    data = data[: len(data) * 3 // 4]
    whole = altered(data)
    wanted, damage = rows(whole), whole.damage
    flips = chance(4)
    # In the last chunk, which is cut, no CRC tells.
    for place in [flips.randrange(len(MAGIC), len(data) - 4000) for _ in range(90 * TIMES)]:
        bent = bytearray(data)
        bent[place] ^= 1 << flips.randrange(8)
        file = altered(bent)
        found = rows(file)
        assert is_subsequence(found, wanted), place
        assert found == wanted or file.damage != damage, place


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_wrong_record_length_costs_one_chunk(tmp_path: Path, compression: Compression) -> None:
    path = tmp_path / "log.mcap"
    with McapWriter(path, compression=compression, library="test") as writer:
        channel = writer.register_channel("key", "", 0)
        starts = []
        for n in range(10):
            starts.append(writer.bytes_written)
            writer.add_message(channel, n, n, n, b"data")
            writer.flush()
    bent = bytearray(path.read_bytes())
    bent[starts[4] + 3] ^= 0x40
    file = altered(bent)
    assert [m.sequence for m in file.messages()] == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    assert f"a record's length is wrong at byte {starts[4]}" in file.damage


@pytest.mark.parametrize("zeros", [1, 27])
def test_a_hole_of_zeros_is_one_fault_and_costs_nothing_however_long_it_is(tmp_path: Path, zeros: int) -> None:
    path = tmp_path / "log.mcap"
    with McapWriter(path, library="test") as writer:
        channel = writer.register_channel("key", "", 0)
        for n in range(5):
            start = writer.bytes_written
            writer.add_message(channel, n, n, n, b"data")
            writer.flush()
    whole = path.read_bytes()
    file = altered(whole[:start] + bytes(zeros) + whole[start:])
    assert [m.sequence for m in file.messages()] == [0, 1, 2, 3, 4]
    assert [said for said in file.damage if said.endswith(f" at byte {start}")] == [
        f"a record's length is wrong at byte {start}"
    ]
    assert not any("unexpected kind" in said for said in file.damage)


@pytest.mark.parametrize("log", ["none"], indirect=True)
def test_a_damaged_chunk_is_named_and_skipped(log: Path) -> None:
    bent = bytearray(log.read_bytes())
    place = bent.index(b"100 100 100 ")
    bent[place] ^= 1
    file = altered(bent)
    lost = set(range(MESSAGES)) - {m.sequence for m in file.messages()}
    assert 100 in lost
    assert len(lost) < 40
    assert any(sentence.startswith("chunk at byte") and "fails its CRC" in sentence for sentence in file.damage)
    assert f"{MESSAGES - len(lost)} of {MESSAGES} messages that were written can be read" in file.lost


@examples(100)
@given(st.binary(max_size=400), st.booleans())
def test_arbitrary_bytes_never_crash(data: bytes, closed: bool) -> None:
    footer = b"\x02\x14" + bytes(7) + data[:20].ljust(20, b"\0") + MAGIC
    file = altered(MAGIC + data + (footer if closed else b""))
    list(file.messages())
    file.summary()
    assert isinstance(file.attachments, dict)
    assert isinstance(file.metadata, dict)


@examples(60)
@given(
    st.lists(
        st.tuples(st.integers(0, 255), st.integers(0, 80), st.binary(max_size=60)).map(
            lambda parts: bytes((parts[0] % 18,)) + parts[1].to_bytes(8, "little") + parts[2]
        )
    )
)
def test_arbitrary_records_never_crash(records: list[bytes]) -> None:
    file = altered(MAGIC + b"".join(records))
    list(file.messages())
    assert isinstance(file.attachments, dict)
    assert isinstance(file.metadata, dict)
    assert file.damage


def test_a_chunk_that_claims_a_huge_size_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with McapWriter(path, library="test") as writer:
        start = writer.bytes_written
        writer.add_message(writer.register_channel("key", "", 0), 0, 0, 0, bytes(10_000))
    bent = bytearray(path.read_bytes())
    bent[start + 25 : start + 33] = (1 << 62).to_bytes(8, "little")
    file = altered(bent)
    assert list(file.messages()) == []
    assert any("claims to hold" in sentence for sentence in file.damage)


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"ros bag V2.0", bytes(100)])
def test_what_is_no_mcap_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    with pytest.raises(NotMcapError, match="is no MCAP file"):
        McapFile(path)


def test_a_folder_is_refused_and_a_missing_file_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(NotMcapError, match="is not a file"):
        McapFile(tmp_path)
    with pytest.raises(FileNotFoundError):
        McapFile(tmp_path / "missing.mcap")
