"""The centralised filter and the bound of logged or simulated runs, as far as the traces hold what was measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking.filters import level_of
from zenoh_cbef.tracking.joint import joint_centralized
from zenoh_cbef.tracking.reference import centralized, posterior_bound

Floats = NDArray[np.float64]


def yardsticks(traces: Sequence[Trace]) -> tuple[Floats, Floats]:
    """States of the centralised filter (r, K, 6) and bounds (r, K, 6, 6) for r runs of one shape, as one batch.

    NaN from the first step on of which a measurement is not in the trace: what follows would know less than the
    network did. The bound is NaN where the truth is not known, too; there it goes on along the centralised estimate.
    """
    measured = [trace.measured_steps for trace in traces]
    truth = _stacked(traces, "truth")
    states, bounds = np.full(truth.shape, np.nan), np.full((*truth.shape, 6), np.nan)
    reach = max(measured)
    states[:, :reach] = centralized_run(traces, reach)[0]
    known = np.isfinite(truth)
    bounds[:, :reach] = _bounds(traces, np.where(known, truth, states)[:, :reach])
    for run, steps in enumerate(measured):
        states[run, steps:] = bounds[run, steps:] = np.nan
    bounds[~known.all(axis=2)] = np.nan
    return states, bounds


def _stacked(traces: Sequence[Trace], part: str) -> Floats:
    return np.stack([getattr(trace, part) for trace in traces])


def _prior(traces: Sequence[Trace]) -> Floats:
    covariance = traces[0].plan.initial_covariance
    return np.broadcast_to(covariance, (len(traces), *covariance.shape))


def centralized_run(traces: Sequence[Trace], steps: int) -> tuple[Floats, Floats]:
    """The centralised filter's states (r, steps, 6) and covariances (r, steps, 6, 6) in the first steps of r runs."""
    plan = traces[0].plan
    initial = plan.belief_at(_stacked(traces, "initial").mean(axis=1))
    xi = level_of(plan.scenario.filter.kind, plan.xi)
    seen = {part: _stacked(traces, part)[:, :, :steps] for part in ("positions", "ranges", "age")}
    settings = plan.settings
    if settings.bias != "none" or settings.first_fix or settings.learns_noise:
        return joint_centralized(initial, settings, xi, **seen)
    motion, space, range_std, power = plan.motion, plan.space, plan.range_std, plan.power
    return centralized(initial, motion, space, range_std=range_std, xi=xi, power=power, **seen)


def _bounds(traces: Sequence[Trace], truth: Floats) -> Floats:
    plan, steps = traces[0].plan, truth.shape[1]
    return posterior_bound(
        _prior(traces),
        plan.plain_motion,
        plan.space,
        truth=truth,
        positions=_stacked(traces, "positions")[:, :, :steps],
        measured=np.isfinite(_stacked(traces, "ranges")[:, :, :steps]),
        age=_stacked(traces, "age")[:, :, :steps],
        range_std=plan.range_std,
    )
