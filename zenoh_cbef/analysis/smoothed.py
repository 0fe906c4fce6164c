"""Smoothed paths: of any run with a covariance, and how good they are beside the centralised smoother's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from zenoh_cbef.analysis.averages import mean_over_agents, ratio_of_rms, rms
from zenoh_cbef.analysis.consistency import described, nees_of
from zenoh_cbef.analysis.results import Smoothing
from zenoh_cbef.analysis.yardsticks import centralized_run, jointly
from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.build import backwards_of
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.trace import SmoothedPath, Trace
from zenoh_cbef.tracking.smoothing import FixedLag, smoothed


@dataclass(frozen=True)
class SmoothedErrors:
    """Errors of the smoothed path in the steps that have an estimate; n agents, K steps.

    position, velocity: (n, K), m and m/s. nees: (n, K). centralized: (K,), m, of the position of the centralised
    smoother with the same lag. path: (K, 3), the mean of the agents' smoothed positions, m.
    """

    lag: int
    position: Floats
    velocity: Floats
    nees: Floats
    centralized: Floats
    path: Floats


def told_whole(plan: Plan) -> bool:
    """Whether position and velocity, which a log holds, are all that the filter knows of the target's motion."""
    return not (plan.models or plan.noises) and plan.motion.size == len(plan.space.kept)


def smoothed_run(trace: Trace) -> Trace:
    """The run with its estimates smoothed over its whole length: each agent alone, by what it said of itself.

    For filters of which that is all (`told_whole`). Raises UserError where the estimates have no covariance.
    """
    known = _sound(trace.covariances)
    if not known.any():
        kind = trace.scenario.filter.kind
        why = f"{kind!r} has no covariance" if not trace.plan.abilities.covariance else "the log holds no covariance"
        raise UserError(
            f"smoothing needs to know how sure each estimate is, but {why}; "
            "estimate again with another filter: zenoh-cbef reestimate LOG --smooth --set filter.kind=sicf"
        )
    states = np.where(known[:, :, None], trace.estimates, np.nan)
    how = trace.plan.plain_motion, trace.plan.space
    found = smoothed(states, trace.covariances, *how, excess=trace.diagnostics.excess)
    return replace(trace, smoothed=SmoothedPath(*found, lag=len(trace.time)))


def _sound(covariances: Floats) -> Bools:
    """Which of (n, K, 6, 6) are covariances, (n, K); in a plane they are zero where the state is known."""
    finite = np.asarray(np.isfinite(covariances).all(axis=(2, 3)))
    least = np.linalg.eigvalsh(np.where(finite[:, :, None, None], covariances, 0.0))
    return np.asarray(finite & (least[:, :, -1] > 0.0) & (least[:, :, 0] >= -1e-9 * least[:, :, -1]))


def smoothed_errors(trace: Trace, counted: Bools, central: Floats | None) -> SmoothedErrors | None:
    """The errors of a run's smoothed path, of all agents; None where it has none.

    counted: (n,), those of the mean. central: of the centralised smoother, see `centralized_paths`.
    """
    path = trace.smoothed
    if path is None or central is None:
        return None
    kept, axes = trace.plan.space.kept, trace.plan.space.axes
    error = np.where(np.isfinite(trace.estimates), path.states - trace.truth, np.nan)[:, :, kept]
    return SmoothedErrors(
        path.lag,
        np.linalg.norm(error[:, :, :axes], axis=2),
        np.linalg.norm(error[:, :, axes:], axis=2),
        nees_of(error, trace.plan.space.kept_covariances(path.covariances)),
        np.linalg.norm((central - trace.truth)[:, kept[:axes]], axis=1),
        mean_over_agents(path.states[counted, :, :3]),
    )


def centralized_paths(traces: Sequence[Trace]) -> Sequence[Floats | None]:
    """The states of the centralised smoother in runs of one shape, (K, 6) each; None of runs without a smoothed path.

    NaN where a log lacks what it needs. Runs that are smoothed alike are one batch.
    """
    alike = {(trace.smoothed.lag if trace.smoothed else 0, trace.measured_steps) for trace in traces}
    if len(alike) > 1:
        return [path for trace in traces for path in centralized_paths([trace])]
    [(lag, steps)] = alike
    if not lag:
        return [None] * len(traces)
    plan, found = traces[0].plan, np.full((len(traces), *traces[0].truth.shape), np.nan)
    if steps == 0 or (jointly(plan) and not told_whole(plan)):
        return list(found)
    window = FixedLag(backwards_of(plan), plan.space, min(lag, steps))
    for step, belief in enumerate(centralized_run(traces, steps), 1):
        window.take(step, belief)
        for one in window.due(last=step == steps):
            found[:, one.step - 1] = one.state
    return list(found)


def smoothing_of(errors: SmoothedErrors, trace: Trace, first: int, counted: Bools) -> Smoothing:
    """What the errors amount to in the window that begins at index `first`; counted: (n,), of these agents."""
    position, central = errors.position[counted, first:], errors.centralized[first:]
    degrees = np.full(errors.nees.shape, len(trace.plan.space.kept))
    [nees] = described(errors.nees[None], degrees[None], time=trace.time, first=first, counted=counted)
    return Smoothing(
        lag=errors.lag,
        position_rmse=rms(position),
        velocity_rmse=rms(errors.velocity[counted, first:]),
        centralized_position_rmse=rms(central),
        ratio_to_centralized=ratio_of_rms(position, central),
        nees=nees,
    )
