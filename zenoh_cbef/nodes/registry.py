"""Which runs go on on this host, and where they are reached: one small file each, as long as its target lives."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from zenoh_cbef.errors import UserError


def _folder() -> Path:
    return Path(os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()) / f"zenoh-cbef-{os.getuid()}"


@contextmanager
def registered(run: str, endpoints: Sequence[str]) -> Iterator[None]:
    """Let other programs of this user find a run, until the block is left. Without a place for that nobody does.

    Raises UserError where a run of this name goes on already: on another network, as it would have been heard of.
    """
    if run in (runs := known_runs()):
        raise UserError(
            f"a run {run!r} goes on on this host already, at {', '.join(runs[run])}; "
            "give this one another name with --run, or end that one"
        )
    path = _folder() / f"{run}.json"
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        path.write_text(json.dumps({"pid": os.getpid(), "endpoints": list(endpoints)}))
    except OSError:
        yield
        return
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink()


def known_runs() -> dict[str, list[str]]:
    """The endpoints of the runs whose targets live on this host, by name."""
    found: dict[str, list[str]] = {}
    for path in sorted(_folder().glob("*.json")):
        with suppress(OSError, ValueError, KeyError, TypeError):
            entry = json.loads(path.read_text())
            os.kill(entry["pid"], 0)
            found[path.stem] = [str(one) for one in entry["endpoints"]]
    return found


def find_run(run: str | None) -> tuple[str, list[str]]:
    """A run of this host and its endpoints, by its name or as the only one. Raises UserError."""
    runs = known_runs()
    if run is None and len(runs) == 1:
        return next(iter(runs.items()))
    there = ", ".join(runs) or "none"
    if run is None:
        raise UserError(f"say which run with --run; on this host there is {there}")
    if run not in runs:
        raise UserError(f"no run {run!r} goes on on this host (there is {there}); give --run, or --connect for another")
    return run, runs[run]
