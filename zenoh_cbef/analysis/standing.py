"""What agents said that their estimates were, and how good these were meanwhile."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.analysis.averages import mean, rms
from zenoh_cbef.analysis.results import Standing
from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking.status import STATUSES, settled


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


def paths_of(trace: Trace) -> Floats:
    """The agents' estimates (n, K, 3) as paths, from their first fix on; all of a run that ended before."""
    estimates = trace.estimates[:, :, :3]
    paths = settled(estimates, trace.diagnostics.status)
    return paths if np.isfinite(paths).any() else estimates


def begun(paths: Floats) -> int:
    """In which row of the paths (n, K, 3) the first one begins."""
    return int(np.isfinite(paths[:, :, 0]).any(axis=0).argmax())


def _standing(now: Bools, known: int, position_error: Floats, nees: Floats) -> Standing:
    error, honest = (np.where(now, values, np.nan) for values in (position_error, nees))
    return Standing(share=float(now.sum()) / known, position_rmse=rms(error), nees=mean(honest))
