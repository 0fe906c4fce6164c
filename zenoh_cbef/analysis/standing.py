"""What agents said that their estimates were, and how good these were meanwhile."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.analysis.averages import mean, rms
from zenoh_cbef.analysis.results import Standing
from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.scenario.start import unguided_seconds
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking.status import FAINT, STATUSES, strokes


def standing_of(trace: Trace, position_error: Floats, nees: Floats, counted: Bools) -> dict[str, Standing] | None:
    """By name of the status: how often it was, over the whole run, and errors and NEES (n, K) meanwhile.

    counted: (n,), the agents that this is over. None for a filter that does not say.
    """
    said = trace.diagnostics.status[counted]
    known = int(np.isfinite(said).sum())
    if not known:
        return None
    return {
        name: _standing(said == number, known, position_error[counted], nees[counted])
        for number, name in enumerate(STATUSES)
    }


def strokes_of(trace: Trace) -> Floats:
    """How strongly the agents' paths are drawn, (n, K): from their first fix on; 1 of a run that ended before."""
    said, fix = trace.diagnostics, trace.plan.first_fix_steps
    drawn = strokes(said.status, said.status_seconds, unguided_seconds(trace.scenario, fix))
    return drawn if drawn.any() else np.ones_like(drawn)


def paths_of(trace: Trace) -> Floats:
    """The agents' estimates (n, K, 3) as paths: NaN where they are not drawn."""
    return np.where((strokes_of(trace) > 0.0)[:, :, None], trace.estimates[:, :, :3], np.nan)


def paths_by_stroke(trace: Trace, agent: int) -> list[tuple[float, Floats]]:
    """The path of an agent, (K, 3), in parts of one stroke each: how strongly, and the path; the fainter first."""
    path, drawn = paths_of(trace)[agent], strokes_of(trace)[agent]
    faint = [(FAINT, path)] if (drawn == FAINT).any() else []
    return [*faint, (1.0, np.where((drawn == 1.0)[:, None], path, np.nan))]


def begun(paths: Floats) -> int:
    """In which row of the paths (n, K, 3) the first one begins."""
    return int(np.isfinite(paths[:, :, 0]).any(axis=0).argmax())


def _standing(now: Bools, known: int, position_error: Floats, nees: Floats) -> Standing:
    return Standing(share=float(now.sum()) / known, position_rmse=rms(position_error[now]), nees=mean(nees[now]))
