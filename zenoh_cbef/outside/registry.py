"""The runs that go on on this host, and their endpoints: a small file for each, locked while its target lives."""

from __future__ import annotations

import fcntl
import json
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from pwd import getpwuid
from typing import IO

from zenoh_cbef.errors import UserError
from zenoh_cbef.outside.origin import own_sessions, starter_sessions
from zenoh_cbef.plain import Json, read_json

_LONGEST = 1 << 16
"""Characters of a file here: endpoints, sessions and a folder."""
_OTHERS = "zenoh-cbef-*/*.json"


@dataclass(frozen=True)
class KnownRun:
    """A run whose target lives on this host.

    endpoints: where it is reached. sessions: those of the operating system that it was started from, the nearest
    first. folder, started: where and when that was, s since the Unix epoch; None where its file does not say.
    """

    name: str
    endpoints: list[str]
    sessions: list[int]
    folder: str | None = None
    started: float | None = None

    @property
    def own(self) -> bool:
        """Whether the run was started from this program's terminal, or without one by the same script."""
        return not own_sessions().isdisjoint(self.sessions)

    def __str__(self) -> str:
        when = "" if self.started is None else f" at {time.strftime('%H:%M', time.localtime(self.started))}"
        where = "" if self.folder is None else f" in {self.folder}"
        known = f", started{when}{where}" if when or where else ""
        return f"{self.name!r}{known}"


def _folder() -> Path:
    return Path(os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()) / f"zenoh-cbef-{os.getuid()}"


@contextmanager
def registered(run: str, endpoints: Sequence[str], *, launched: bool = False) -> Iterator[None]:
    """Let other programs of this user find a run, until the block is left; without a place for that none does.

    launched: whether `run` has started this process. Raises UserError where a run of this name goes on already: on
    another network, as it would have been heard of.
    """
    refuse_what_goes_on(run)
    path = _folder() / f"{run}.json"
    with ExitStack() as held:
        with suppress(OSError):
            path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)  # others may know which runs are on
            unseen = path.with_suffix(f".{os.getpid()}")
            file = held.enter_context(unseen.open("w"))
            # However the process ends, the lock ends with it. No program sees the file without.
            fcntl.flock(file, fcntl.LOCK_EX)
            told = {"endpoints": list(endpoints), "sessions": starter_sessions(launched=launched)}
            starter = {"starter": os.getppid()} if launched else {}
            file.write(json.dumps(told | {"folder": str(Path.cwd()), "started": time.time()} | starter))
            file.flush()
            held.push(partial(_withdraw, path, launched))
            unseen.rename(path)
        yield


def _withdraw(path: Path, launched: bool, failure: type[BaseException] | None, *_: object) -> None:
    """Remove the file of a run; where its target fails, agents that `run` has started go on without it."""
    if failure is None or not launched:
        path.unlink(missing_ok=True)


def refuse_what_goes_on(run: str) -> None:
    """Raise UserError where a run of this name goes on on this host."""
    if run in (runs := known_runs()):
        raise UserError(
            f"a run {run!r} goes on on this host already, at {', '.join(runs[run].endpoints)}; "
            "give this one another name with --run, or end that one"
        )


def known_runs() -> dict[str, KnownRun]:
    """The runs whose targets live on this host, by name."""
    return _runs()[0]


def _runs() -> tuple[dict[str, KnownRun], list[str]]:
    """The runs whose targets live on this host, and the names of those of which only `run` and agents are left."""
    found: dict[str, KnownRun] = {}
    left: list[str] = []
    for path in sorted(_folder().glob("*.json")):
        with suppress(OSError, ValueError, TypeError, KeyError), path.open() as file:
            if os.fstat(file.fileno()).st_uid != os.getuid():
                continue
            if _locked(file):
                found[path.stem] = _read(path.stem, file)
            elif _lives(_table(file).get("starter")):
                left.append(path.stem)
            else:
                path.unlink()  # Its target was killed.
    return found, left


def others_runs() -> dict[str, str]:
    """The runs of other users of this host, as far as this one may see them: the user of each, by the run's name."""
    found: dict[str, str] = {}
    places = [*Path(tempfile.gettempdir()).glob(_OTHERS), *Path("/run/user").glob(f"*/{_OTHERS}")]
    for place in places:
        with suppress(OSError, KeyError), place.open() as file:
            owner = os.fstat(file.fileno()).st_uid
            if owner != os.getuid() and _locked(file):
                found[place.stem] = getpwuid(owner).pw_name
    return found


def _lives(process: object) -> bool:
    with suppress(OSError):
        if isinstance(process, int) and process > 0:
            os.kill(process, 0)
            return True
    return False


def _table(file: IO[str]) -> dict[str, Json]:
    told = read_json(file.read(_LONGEST))
    return told if isinstance(told, dict) else {"endpoints": told}  # as earlier versions wrote it


def _read(name: str, file: IO[str]) -> KnownRun:
    table = _table(file)
    endpoints, sessions = table.get("endpoints"), table.get("sessions", [])
    if not isinstance(endpoints, list) or not isinstance(sessions, list):
        raise TypeError
    folder, started = table.get("folder"), table.get("started")
    return KnownRun(
        name,
        [one for one in endpoints if isinstance(one, str)],
        [one for one in sessions if isinstance(one, int)],
        folder if isinstance(folder, str) else None,
        started if isinstance(started, float) else None,
    )


def _locked(file: IO[str]) -> bool:
    """Whether the process that wrote a file still lives."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False


def find_run(run: str | None) -> KnownRun:
    """A run of this host, by its name or as the only one. Raises UserError."""
    runs, left = _runs()
    if run is None and len(runs) == 1:
        return next(iter(runs.values()))
    several = "are the runs" if len(runs) > 1 else "is run"
    there = f"there {several} {', '.join(runs)}" if runs else "there is none"
    lacking = not runs if run is None else run not in runs
    if lacking and (lost := [name for name in left if run in {None, name}]):
        raise UserError(
            f"the target of run {lost[0]!r} has died, so the run takes no order and tells nothing; its agents go on to "
            "the last step without it: wait for that, or end 'zenoh-cbef run' with Ctrl-C"
        )
    others = {name: user for name, user in others_runs().items() if run in {None, name}} if lacking else {}
    if others:
        named = ", ".join(f"{name!r} of user {user}" for name, user in others.items())
        raise UserError(f"on this host there is run {named}, not yours; ask its user for the --connect of it")
    if run is None and runs:
        raise UserError(f"on this host {there}; say which run with --run")
    if run is None:
        raise UserError("no run goes on on this host; start one, or reach one of another host with --connect")
    if run not in runs:
        remedy = "name one of these" if runs else "start it"
        raise UserError(
            f"no run {run!r} goes on on this host ({there}); {remedy}, or give --connect for another host's"
        )
    return runs[run]
