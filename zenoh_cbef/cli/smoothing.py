"""What --smooth does, for every verb that has it."""

from __future__ import annotations

from pathlib import Path

from rich.progress import Progress

from zenoh_cbef.cli.console import errors, tell
from zenoh_cbef.log.prove.smoothed import smoothed_trace
from zenoh_cbef.trace import Trace


def smoothed(trace: Trace, *paths: Path) -> Trace:
    """A run with its smoothed path; paths: of its log."""
    with Progress(console=errors, transient=True, disable=not errors.is_terminal) as progress:
        task = progress.add_task("smoothing", total=len(trace.time))
        found, note = smoothed_trace(trace, *paths, progress=lambda step: progress.update(task, completed=step))
    if note:
        tell(f"note: {trace.name}: {note}")
    return found
