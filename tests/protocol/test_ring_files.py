"""Rings leave no file open behind them, and only their user's processes open them."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from pathlib import Path

import pytest

from zenoh_cbef.protocol.ring import LEAST_BYTES, RingError, RingReader, RingWriter, is_written
from zenoh_cbef.protocol.ring_folder import FOLDER, RingFolder, tag_of


def alive(_tag: int) -> bool:
    return True


def open_below(folder: Path) -> list[str]:
    """The names of the files of a folder that this process has open, one as often as it has."""
    found = []
    for one in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # another thread's, closed meanwhile
            found.append(one.readlink())
    return sorted(path.name for path in found if path.parent == folder)


def test_a_ring_is_its_users_own_and_every_look_at_it_ends(tmp_path: Path) -> None:
    path = tmp_path / "one.ring"
    writer = RingWriter(path, ["range"], LEAST_BYTES, alive)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    before = open_below(tmp_path)
    assert is_written(path)
    reader = RingReader(path, 1, alive)
    assert len(open_below(tmp_path)) > len(before)
    reader.close()
    assert open_below(tmp_path) == before
    writer.close(remove=True)
    assert not is_written(path)
    path.write_bytes(b"no ring")
    with pytest.raises(RingError):
        RingReader(path, 1, alive)
    assert not is_written(path)
    assert open_below(tmp_path) == []


def test_who_is_refused_as_a_reader_or_is_alone_no_more_holds_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path))
    folder = RingFolder("run", "ab12")
    folder.make()
    held = folder.enter(tag_of("record/record"))
    assert held is not None
    before = open_below(folder.path)
    assert len(before) == 1
    assert folder.enter(tag_of("record/record")) is None
    with folder.alone():
        assert open_below(folder.path) == sorted([*before, "claims"])
    assert open_below(folder.path) == before
    os.close(held)
