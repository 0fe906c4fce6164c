"""What the log tools share: the choice of messages, and the exit status where some could not be read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.log.tools.selection import Selection, select, time_of

LOSSY = 3
"""Exit status where something could not be read."""


def nothing_matches(log: Path) -> str:
    """What to tell where no message was chosen."""
    return f"note: no message of the log matches; 'zenoh-cbef info {log}' has its topics and times"


def selection_of(
    log: Log, include: Sequence[str] | None, exclude: Sequence[str] | None, start: str | None, end: str | None
) -> Selection:
    """The selection that a command line describes."""

    def first() -> int:
        return log.summary().start_time

    times = {
        name: time_of(text, first, f"--{name}") for name, text in (("start", start), ("end", end)) if text is not None
    }
    return select(include or (), exclude or (), **times)
