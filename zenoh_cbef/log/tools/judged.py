"""What came of the runs in logs/, also of those that no verb has analysed yet."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.outputs import write_outputs
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.header import read_header
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.log.tools.collection import UNKNOWN, Kept, again


def judged(runs: Sequence[Kept], progress: Callable[[str], None] = lambda _name: None) -> list[Kept]:
    """Runs with their results: of one that has ended without any, the log is analysed, and its metrics are kept.

    progress: called with the name of each run that is analysed. A run whose log cannot be read stays unknown; one that
    was stopped before its first step has nothing to analyse.
    """
    return [_analysed(one, progress) if one.result == UNKNOWN and not one.goes_on else one for one in runs]


def _analysed(run: Kept, progress: Callable[[str], None]) -> Kept:
    progress(run.name)
    try:
        analysis = analyze([read_trace(run.log)])[0]
    except UserError:
        return again(run, {"stopped": True} if _was_stopped(run) else {})
    write_outputs(analysis, run.log.parent, report=False)  # where they cannot be kept, the next call finds them anew
    return again(run, analysis.metrics.as_json())


def _was_stopped(run: Kept) -> bool:
    """Whether the log was closed as that of a run that ended early."""
    try:
        end = read_header(open_log(run.log)).end
    except UserError:
        return False
    return end is not None and end.get("status") == "stopped"
