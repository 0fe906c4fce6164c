"""Where the rings of a run are on this host, and who of it is alive."""

from __future__ import annotations

import fcntl
import os
import re
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import blake2b
from pathlib import Path
from typing import NamedTuple

from zenoh_cbef.protocol.ring import is_written

FOLDER = "ZENOH_CBEF_RINGS"
"""The environment variable that names another folder for the rings of all runs."""
_MEMORY = Path("/dev/shm")  # noqa: S108
_RING = re.compile(r"(-1|\d{1,6})\.(\d{1,20})\.([0-9a-f]{1,40})\.ring")
OF_TARGET = -1
"""In place of an agent's id in the name of the target's ring."""
_READER = "reader-"
_STALE_SECONDS = 3600.0
_TRIES, _AGAIN_SECONDS = 20, 0.02


class RingName(NamedTuple):
    """agent: whose, or OF_TARGET; made: when, ns; life: the session of the process."""

    agent: int
    made: int
    life: str


def _all_runs() -> Path:
    given = os.environ.get(FOLDER)
    if given:
        return Path(given)
    base = _MEMORY if os.access(_MEMORY, os.W_OK) else Path(tempfile.gettempdir())
    return base / f"zenoh-cbef-{os.getuid()}"


class RingFolder:
    """The rings of one run, as its target's life tells it from others of its name. It is of one user alone."""

    def __init__(self, run: str, life: str) -> None:
        self.path = _all_runs() / f"{run}.{life}"

    def make(self) -> None:
        """Make the folder. Raises OSError, also where it is another user's."""
        for folder in (self.path.parent, self.path):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            found = folder.lstat()
            if found.st_uid != os.getuid() or folder.is_symlink():
                raise PermissionError(f"{folder} is another user's")
        _sweep(self.path.parent, _STALE_SECONDS)

    def ring(self, agent: int, life: str) -> Path:
        """The file of a new ring of an agent's process, or of the target's."""
        return self.path / f"{agent}.{time.time_ns()}.{life}.ring"

    def rings(self) -> list[tuple[RingName, Path]]:
        """The rings that are there, the oldest first."""
        found = []
        with suppress(OSError):
            for path in self.path.iterdir():
                if parts := _RING.fullmatch(path.name):
                    found += [(RingName(int(parts[1]), int(parts[2]), parts[3]), path)]
        return sorted(found, key=lambda one: one[0].made)

    def is_read(self, tag: int) -> bool:
        """Whether the reader with a tag is alive."""
        return is_written(self.path / f"{_READER}{tag:x}")

    def enter(self, tag: int) -> int | None:
        """Be the reader with a tag until the file that this returns is closed; None where another is."""
        file = os.open(self.path / f"{_READER}{tag:x}", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        for _ in range(_TRIES):  # A look at the lock takes it for a moment.
            with suppress(OSError):
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return file
            time.sleep(_AGAIN_SECONDS)
        os.close(file)
        return None

    @contextmanager
    def alone(self) -> Iterator[None]:
        """One process at a time does what is in the block: becoming a reader of rings."""
        file = os.open(self.path / "claims", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield
        finally:
            os.close(file)

    def tidy(self) -> None:
        """Remove the folder where no ring is left in it."""
        _remove_empty(self.path)


def tag_of(recorder: str) -> int:
    """The number that stands for a recorder's name in rings."""
    return int.from_bytes(blake2b(recorder.encode(), digest_size=8).digest(), "little") or 1


def clear_rings(run: str) -> None:
    """Remove what ended processes of a run have left; its launcher calls this last."""
    for folder in _all_runs().glob(f"{run}.*"):
        if folder.name.rpartition(".")[0] == run:
            _clear(folder, 0.0)


def _sweep(all_runs: Path, seconds: float) -> None:
    """Remove rings that processes left so long ago which were killed, with no recorder after them."""
    for folder in all_runs.iterdir():
        with suppress(OSError):
            if time.time() - folder.stat().st_mtime > seconds:
                _clear(folder, seconds)


def _clear(folder: Path, seconds: float) -> None:
    with suppress(OSError):
        if any(is_written(one) for one in folder.glob(f"{_READER}*")):
            return
        for ring in [*folder.glob("*.ring"), *folder.glob("*.new")]:
            if time.time() - ring.stat().st_mtime >= seconds and not is_written(ring):
                ring.unlink()
        _remove_empty(folder)


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):
        if any(folder.glob("*.ring")) or any(is_written(one) for one in folder.glob(f"{_READER}*")):
            return
        for one in [*folder.glob(f"{_READER}*"), *folder.glob("claims")]:
            one.unlink()
        folder.rmdir()
