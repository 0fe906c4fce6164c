"""The smoothed path of a logged run, whatever its filter: from the log's estimates, or from the filter once more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from zenoh_cbef.analysis.smoothed import smoothed_run, told_whole
from zenoh_cbef.log.read.measurements import Measurements, read_measurements
from zenoh_cbef.scenario.build import backwards_of
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import Simulation, heard_in
from zenoh_cbef.trace import SmoothedPath, Trace
from zenoh_cbef.tracking.smoothing import FixedLag

_OTHER = (
    "the filter knows more of the target's motion than the position and velocity in the log, so it was computed again "
    "from the ranges, as in lockstep: the smoothed path is of that, and {differing} of the log's {all} estimates differ"
)


def smoothed_trace(trace: Trace, *paths: Path, progress: Callable[[int], None] = lambda _: None) -> tuple[Trace, str]:
    """A run with its estimates smoothed over its whole length, and a note where the path is of other estimates.

    paths: of its log, for filters whose estimates the log does not hold whole; these are computed once more, and
    progress is called with each step. Raises UserError where estimates have no covariance or the log no measurements.
    """
    path = trace.smoothed
    if path is not None and path.lag >= len(trace.time):
        return trace, ""
    if not trace.plan.abilities.covariance or told_whole(trace.plan):
        return smoothed_run(trace), ""
    path, differing, number = _computed_again(read_measurements(*paths), trace, progress)
    return replace(trace, smoothed=path), _OTHER.format(differing=differing, all=number) if differing else ""


def _computed_again(
    found: Measurements, trace: Trace, progress: Callable[[int], None]
) -> tuple[SmoothedPath, int, int]:
    """The path, and how many of how many estimates in the log are not those that it is of."""
    plan = Plan(found.loaded([f"steps={min(found.steps, len(trace.time))}", 'timing.mode="lockstep"']).scenario)
    simulation = Simulation([plan], [heard_in(plan, found.world(plan.scenario))])
    steps = plan.scenario.length
    window = FixedLag(backwards_of(plan), plan.space, steps)
    path = SmoothedPath.empty(len(trace.estimates), len(trace.time), steps)
    differing = number = 0
    for k, step in enumerate(simulation):
        # An agent that is away, or begins anew, goes on from its prediction here: its path has no gap.
        window.take(k + 1, simulation.tracker.belief)
        logged = np.asarray(np.isfinite(trace.estimates[:, k]).all(axis=1))
        differing += int((step.estimate.state[logged] != trace.estimates[logged, k]).any(axis=1).sum())
        number += int(logged.sum())
        progress(k + 1)
    path.put(window.rest(), np.zeros(len(path.states), dtype=bool))
    return path, differing, number
