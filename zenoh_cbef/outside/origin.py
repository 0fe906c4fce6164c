"""The session of the operating system from which a program was started; by it we know the runs of this terminal."""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import islice, takewhile
from pathlib import Path

_INIT = 1


def starter_sessions(*, launched: bool) -> list[int]:
    """The ids of the sessions that a run was started from, the nearest first, up to the first one with a terminal.

    Scripts often give each command a session of its own; the session of the script is then one further up.
    launched: whether this process was started by `run`, which then is what was started.
    """
    found: list[int] = []
    for number, (session, terminal) in enumerate(_lineage()):
        if number == 0 and launched:
            continue  # `run` gives each process a session of its own.
        found.append(session)
        if terminal:
            break
    return list(dict.fromkeys(found))


def own_sessions() -> set[int]:
    """The sessions whose runs are this program's own: that of its terminal, else its own and its parent's."""
    own, *above = islice(_lineage(), 2)
    return {own[0]} if own[1] else {session for session, _ in (own, *above)}


def _lineage() -> Iterator[tuple[int, bool]]:
    """The sessions of this process, its parent and so on, each with whether it has a terminal; not the system's first.

    A process of a container sees 0 for a session that began outside. Such a session goes by its first process inside.
    """
    above = list(_processes())
    for place, (process, session, terminal) in enumerate(above):
        if session:
            if process != _INIT:
                yield session, terminal
            continue
        inside = takewhile(lambda one: not one[1], above[place:])
        yield -[process for process, *_ in inside][-1], terminal


def _processes() -> Iterator[tuple[int, int, bool]]:
    """Id and session of this process, its parent and so on, and whether each has a terminal."""
    process = os.getpid()
    while process > 0:
        try:
            # Linux: the numbers after the name are state, parent, group, session and terminal.
            words = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2]
            parent, _, session, terminal = map(int, words.split()[1:5])
        except (OSError, ValueError):
            yield from _without_proc(process)
            return
        yield process, session, terminal != 0
        process = parent


def _without_proc(process: int) -> Iterator[tuple[int, int, bool]]:
    if process == os.getpid():
        yield process, os.getsid(0), False
        if os.getppid() > _INIT:
            yield os.getppid(), os.getsid(os.getppid()), False
