"""What came of the runs in logs/, also of those that no verb has analysed yet."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.outputs import write_outputs
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import ACTIVE
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.log.tools.collection import UNKNOWN, Kept, again
from zenoh_cbef.outside.registry import known_runs


def judged(runs: Sequence[Kept], progress: Callable[[str], None] = lambda _name: None) -> list[Kept]:
    """Runs with their results: of one that has ended without any, the log is analysed, and its metrics are kept.

    progress: called with the name of each run that is analysed. A run whose log cannot be read stays unknown.
    """
    going = known_runs()
    found = []
    for one in runs:
        on = one.log.name.endswith(ACTIVE) and one.run in going
        if one.result == UNKNOWN and not on:
            progress(one.name)
            found.append(_analysed(one))
        else:
            found.append(one)
    return found


def _analysed(run: Kept) -> Kept:
    try:
        analysis = analyze([read_trace(run.log)])[0]
    except UserError:
        return run
    write_outputs(analysis, run.log.parent, report=False)  # where they cannot be kept, the next call finds them anew
    return again(run, analysis.metrics.as_json())
