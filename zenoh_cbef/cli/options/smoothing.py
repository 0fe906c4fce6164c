"""What --smooth does, for every verb that has it."""

from __future__ import annotations

from pathlib import Path

from zenoh_cbef.cli.terminal.console import tell
from zenoh_cbef.cli.terminal.progress import bar
from zenoh_cbef.log.prove.smoothed import smoothed_trace
from zenoh_cbef.trace import Trace


def smoothed(trace: Trace, *paths: Path) -> Trace:
    """A run with its smoothed path; paths: of its log."""
    with bar("smoothing", len(trace.time)) as done:
        found, note = smoothed_trace(trace, *paths, progress=done)
    if note:
        tell(f"note: {trace.name}: {note}")
    return found
