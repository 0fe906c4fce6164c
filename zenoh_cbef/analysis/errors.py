"""The errors of a run: of its agents, of the centralised filters beside them, and what the bound allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.analysis.averages import mean_over_agents, running_mean
from zenoh_cbef.analysis.consistency import chi2_band, nees_of
from zenoh_cbef.analysis.faulted import honest_agents
from zenoh_cbef.analysis.smoothed import SmoothedErrors, smoothed_errors
from zenoh_cbef.analysis.yardsticks import Yardsticks
from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking.ranging import Space


@dataclass(frozen=True)
class Errors:
    """A trace with its errors; n agents, K steps, errors in m and m/s.

    first: index of the first step of the scored window. counted: (n,), the agents that averages are over: all but
    those that the scenario lets send wrong values. msee: (n, K), the paper's running mean of |xhat - x|^2;
    msee_average: (K,). position_error, velocity_error: (n, K). nees: (n, K), NaN for a filter without covariance;
    nees_band: its 95 % band. disagreement: (K,), m, root mean square distance of the agents' positions from their
    mean. centralized_states: (K, 6), centralized_msee, centralized_position_error: (K,). strong_states,
    strong_position_error: of the strong yardstick (see Yardsticks). bound: (K, 6, 6), bound_position_error, bound_msee:
    (K,). smoothed: None where the run has no smoothed path. NaN where the trace lacks what is needed.
    """

    trace: Trace
    first: int
    counted: Bools
    msee: Floats
    msee_average: Floats
    position_error: Floats
    velocity_error: Floats
    nees: Floats
    nees_band: tuple[float, float]
    disagreement: Floats
    centralized_states: Floats
    centralized_msee: Floats
    centralized_position_error: Floats
    strong_states: Floats
    strong_position_error: Floats
    bound: Floats
    bound_position_error: Floats
    bound_msee: Floats
    smoothed: SmoothedErrors | None


def errors_of(trace: Trace, beside: Yardsticks, skip: float, path: Floats | None = None) -> Errors:
    """The errors of a trace. skip: see `analyze`. path: of the centralised smoother, (K, 6), where it is smoothed.

    Those of a step rest on that step alone, but running means do not.
    """
    states, bound = beside.centralized, beside.bound
    space = trace.plan.space
    error, reference = (estimated_only(space, each - trace.truth) for each in (trace.estimates, states))
    strong = estimated_only(space, beside.strong - trace.truth)
    square, squares = error**2, reference**2
    positions = trace.estimates[:, :, :3]
    counted = honest_agents(trace.scenario)
    present = np.isfinite(positions).all(axis=2) & counted[:, None]
    number = np.maximum(present.sum(axis=0), 1)
    middle = np.where(present[:, :, None], positions, 0.0).sum(axis=0) / number[:, None]
    apart = np.where(present, np.sum((positions - middle) ** 2, axis=2), 0.0)
    total = np.sum(square, axis=2)
    return Errors(
        trace=trace,
        first=_first(np.asarray(np.isfinite(error[counted]).all(axis=2).any(axis=0)), skip),
        counted=counted,
        msee=running_mean(total),
        msee_average=running_mean(mean_over_agents(total[counted])),
        position_error=np.sqrt(np.sum(square[:, :, :3], axis=2)),
        velocity_error=np.sqrt(np.sum(square[:, :, 3:], axis=2)),
        nees=nees_of(space.kept_states(error), space.kept_covariances(trace.covariances)),
        nees_band=chi2_band(len(space.kept)),
        disagreement=np.where(present.any(axis=0), np.sqrt(apart.sum(axis=0) / number), np.nan),
        centralized_states=states,
        centralized_msee=running_mean(np.sum(squares, axis=1)),
        centralized_position_error=np.sqrt(np.sum(squares[:, :3], axis=1)),
        strong_states=beside.strong,
        strong_position_error=np.sqrt(np.sum(strong[:, :3] ** 2, axis=1)),
        bound=bound,
        bound_position_error=np.sqrt(np.trace(bound[:, :3, :3], axis1=1, axis2=2)),
        bound_msee=running_mean(np.trace(bound, axis1=1, axis2=2)),
        smoothed=smoothed_errors(trace, counted, path),
    )


def _first(scorable: Bools, skip: float) -> int:
    """Index of the first step of the window: a share of the steps (K,) is left out, or of those that can be scored.

    Whichever is less: where the truth ends early, the window would begin after all that can be scored.
    """
    places = np.flatnonzero(scorable)
    most = min(int(skip * len(scorable)), len(scorable) - 1)
    return min(most, int(places[min(int(skip * len(places)), len(places) - 1)])) if len(places) else most


def estimated_only(space: Space, error: Floats) -> Floats:
    """Errors (..., 6) along the estimated axes; in a plane the height is given, so it is no error of the tracker's."""
    if space.height is None:
        return error
    counted = np.zeros(6, dtype=bool)
    counted[space.kept] = True
    return np.where(counted, error, 0.0)
