"""Rings leave no file open behind them, and only their user's processes open them."""

from __future__ import annotations

import fcntl
import os
import stat
import time
from contextlib import suppress
from pathlib import Path

import pytest

from zenoh_cbef.protocol.ring import LEAST_BYTES, RingError, RingReader, RingWriter, is_written
from zenoh_cbef.protocol.ring_folder import FOLDER, RingFolder, clear_rings, tag_of


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


@pytest.mark.slow
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
        with (folder.path / "claims").open("rb") as another, pytest.raises(BlockingIOError):
            fcntl.flock(another, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with (folder.path / "claims").open("rb") as another:
        fcntl.flock(another, fcntl.LOCK_EX | fcntl.LOCK_NB)
    assert open_below(folder.path) == before
    os.close(held)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RingFolder:
    monkeypatch.setenv(FOLDER, str(tmp_path / "rings"))
    found = RingFolder("run", "ab12")
    found.make()
    return found


def test_folders_and_files_are_their_users_alone(folder: RingFolder) -> None:
    held = folder.enter(7)
    assert held is not None
    with folder.alone():
        pass
    assert [stat.S_IMODE(one.stat().st_mode) for one in (folder.path.parent, folder.path)] == [0o700] * 2
    assert [stat.S_IMODE(one.stat().st_mode) for one in sorted(folder.path.iterdir())] == [0o600] * 2
    os.close(held)
    folder.make()  # which may be there


def test_a_folder_is_removed_where_neither_a_ring_nor_a_reader_is_left(folder: RingFolder) -> None:
    held = folder.enter(7)
    with folder.alone():
        pass
    folder.tidy()
    clear_rings("run")
    assert folder.path.exists()
    assert held is not None
    os.close(held)
    ring = folder.ring(3, "ab12")
    RingWriter(ring, ["range"], LEAST_BYTES, alive).close(remove=False)
    folder.tidy()
    assert ring.exists()
    ring.unlink()
    folder.tidy()
    assert not folder.path.exists()
    folder.tidy()


def test_who_makes_a_folder_removes_others_that_were_left_an_hour_ago(folder: RingFolder) -> None:
    old, young = RingFolder("old", "1"), RingFolder("young", "2")
    for one, age in ((old, 3700.0), (young, 3500.0)):
        one.make()
        ring = one.ring(1, "1")
        RingWriter(ring, ["range"], LEAST_BYTES, alive).close(remove=False)
        then = time.time() - age
        os.utime(ring, (then, then))
        os.utime(one.path, (then, then))
    folder.make()
    assert (old.path.exists(), young.path.exists()) == (False, True)
    assert len(young.rings()) == 1


def test_rings_have_a_folder_of_their_user_where_none_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(FOLDER, raising=False)
    for writable, base in ((True, Path("/dev/shm")), (False, Path("/elsewhere"))):  # noqa: S108
        monkeypatch.setattr(os, "access", lambda _, mode, may=writable: may and mode == os.W_OK)
        monkeypatch.setattr("tempfile.gettempdir", lambda: "/elsewhere")
        assert RingFolder("run", "ab12").path == base / f"zenoh-cbef-{os.getuid()}" / "run.ab12"


def test_the_number_of_a_reader_is_never_that_of_none() -> None:
    assert tag_of("record/record") == tag_of("record/record") != tag_of("record/other")
    assert 0 < tag_of("record/record") < 1 << 64
