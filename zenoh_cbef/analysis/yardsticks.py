"""The yardsticks of logged or simulated runs, as far as the traces hold what was measured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from zenoh_cbef.analysis.prior import known_together
from zenoh_cbef.analysis.strong import strong
from zenoh_cbef.analysis.strong.told import told
from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking.central_models import CentralModels, centralized_models
from zenoh_cbef.tracking.filters import Belief, level_of
from zenoh_cbef.tracking.joint import joint_beliefs
from zenoh_cbef.tracking.motion import begun
from zenoh_cbef.tracking.reference import Ranges, centralized_beliefs, each_step, posterior_bound

DOUBT = 1.5
"""From how many times the bound's error on the strong yardstick is computed, which takes long.

Where the filter assumes several motions it always is: the bound is that of the calmest, and so says little of a turn.
"""


@dataclass(frozen=True)
class Yardsticks:
    """Of one run: states of the centralised filter and of the strong one (K, 6), and bounds (K, 6, 6); NaN if unknown.

    strong: of the strong yardstick where the centralised filter is in doubt or assumes several motions, elsewhere, or
    where it is not asked for, the centralised filter's.
    """

    centralized: Floats
    strong: Floats
    bound: Floats


def yardsticks(traces: Sequence[Trace], *, strongest: bool = True) -> list[Yardsticks]:
    """The yardsticks of runs of one shape, as one batch. strongest: whether the strong one is asked for.

    NaN from the first step on of which a measurement is not in the trace: what follows would know less than the
    network did. The bound is NaN where the truth is not known, too; there it goes on along the centralised estimate.
    """
    measured = [trace.measured_steps for trace in traces]
    truth = _stacked(traces, "truth")
    states, bounds = np.full(truth.shape, np.nan), np.full((*truth.shape, 6), np.nan)
    reach = max(measured)
    if reach:
        space = traces[0].plan.space
        states[:, :reach] = np.stack([space.embed_state(one.state) for one in centralized_run(traces, reach)], axis=1)
    known = np.isfinite(truth)
    bounds[:, :reach] = _bounds(traces, np.where(known, truth, states)[:, :reach])
    bounds[~known.all(axis=2)] = np.nan
    best = states.copy()
    plan = traces[0].plan
    doubted = np.flatnonzero(bool(plan.models) | _doubted(plan, states - truth, bounds)).tolist()
    if doubted and strongest:
        found, _ = strong(*told([traces[run] for run in doubted], reach))
        best[np.ix_(np.array(doubted), np.arange(reach), traces[0].plan.space.kept)] = found
    for run, steps in enumerate(measured):
        states[run, steps:] = best[run, steps:] = bounds[run, steps:] = np.nan
    return [Yardsticks(*each) for each in zip(states, best, bounds, strict=True)]


def _doubted(plan: Plan, error: Floats, bounds: Floats) -> Bools:
    """The runs (r,) in which the centralised filter is much worse than the bound, once it has settled."""
    axes = plan.space.kept[: plan.space.axes]
    square = np.sum(error[:, :, axes] ** 2, axis=2)
    least = np.sum(np.diagonal(bounds, axis1=2, axis2=3)[:, :, axes], axis=2)
    scored = np.isfinite(least)
    scored[:, : min(plan.settling_steps, scored.shape[1] // 2)] = False
    sums = (np.where(scored, part, 0.0).sum(axis=1) for part in (square, least))
    reached, bound = sums
    return np.asarray(~(reached <= DOUBT**2 * bound))


def _stacked(traces: Sequence[Trace], part: str) -> Floats:
    return np.stack([getattr(trace, part) for trace in traces])


def _prior(traces: Sequence[Trace]) -> Floats:
    covariance = known_together(traces[0].plan)
    return np.broadcast_to(covariance, (len(traces), *covariance.shape))


def centralized_run(traces: Sequence[Trace], steps: int) -> Iterator[Belief]:
    """The centralised filter's beliefs of the first steps of r runs, along the estimated axes."""
    plan = traces[0].plan
    seen = {part: _stacked(traces, part)[:, :, :steps] for part in ("positions", "ranges", "age")}
    return centralized_steps(plan, _stacked(traces, "initial"), each_step(**seen, range_std=plan.range_std))


def centralized_steps(plan: Plan, initial: Floats, steps: Iterator[Ranges]) -> Iterator[Belief]:
    """The centralised filter's beliefs of r runs, along the estimated axes, a step for each that is given.

    initial: the agents' initial states, (r, n, 6).
    """
    belief = plan.belief_at(initial.mean(axis=1))
    xi, agents = level_of(plan.scenario.filter.kind, plan.xi), initial.shape[1]
    if jointly(plan):
        yield from joint_beliefs(belief, plan.settings, xi, agents, steps)
        return
    if plan.first_fix_steps:
        first = islice(steps, plan.first_fix_steps)
        for found in joint_beliefs(belief, plan.settings, xi, agents, first):
            belief = Belief(*begun(plan.motion, found.state, found.known_covariance))
            yield belief
    if plan.models or plan.noises:
        settings = plan.settings
        models = CentralModels(settings.switching, plan.space, xi, plan.power, settings.widens, settings.weighed)
        yield from centralized_models(belief, models, steps)
    else:
        yield from centralized_beliefs(
            *(belief, plan.motion, plan.space, steps),
            xi=xi,
            power=plan.power,
            widens=plan.settings.widens,
            outliers=plan.settings.weighed,
        )


def jointly(plan: Plan) -> bool:
    """Whether the centralised filter estimates more than the target, of which only position and velocity are told."""
    return plan.settings.bias != "none" or plan.settings.learns_noise


def _bounds(traces: Sequence[Trace], truth: Floats) -> Floats:
    plan, steps = traces[0].plan, truth.shape[1]
    return posterior_bound(
        _prior(traces),
        plan.calm_motion,
        plan.space,
        truth=truth,
        positions=_stacked(traces, "positions")[:, :, :steps],
        measured=np.isfinite(_stacked(traces, "ranges")[:, :, :steps]),
        age=_stacked(traces, "age")[:, :, :steps],
        range_std=plan.range_std,
    )
