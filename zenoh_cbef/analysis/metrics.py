"""The metrics of a run: the paper's MSEE, errors against the centralised filter and the bound, consistency, traffic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.analysis.averages import last, mean_over_agents, rms, running_mean
from zenoh_cbef.analysis.below import bound_note
from zenoh_cbef.analysis.claimed import claimed_position_error
from zenoh_cbef.analysis.consistency import agents_bands, chi2_band, described, nees_of
from zenoh_cbef.analysis.coverage import estimated_steps, lacks, stretches, unseen_note
from zenoh_cbef.analysis.demand import link_bytes
from zenoh_cbef.analysis.link_metrics import links_of, totals_of
from zenoh_cbef.analysis.misfit import misfit_note
from zenoh_cbef.analysis.observability import unseen_steps
from zenoh_cbef.analysis.receivers import bias_of, distrust_of
from zenoh_cbef.analysis.results import (
    Honesty,
    Messages,
    Metrics,
    Msee,
    Nis,
    Number,
    Scored,
    Yardstick,
)
from zenoh_cbef.analysis.slowness import slow_note, slowness
from zenoh_cbef.analysis.smoothed import SmoothedErrors, centralized_paths, smoothed_errors, smoothing_of
from zenoh_cbef.analysis.standing import standing_of
from zenoh_cbef.analysis.yardsticks import Yardsticks, yardsticks
from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.faults import SenderFault
from zenoh_cbef.numbers import number
from zenoh_cbef.trace import Trace

LOST = 3.0
"""From how many times the strong yardstick's position RMSE on a filter has lost the target."""


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


@dataclass(frozen=True)
class Analysis(Errors):
    """A trace with its errors and what they amount to."""

    metrics: Metrics


def analyze(traces: Sequence[Trace], skip: float = 0.25, *, strongest: bool = True) -> list[Analysis]:
    """Analyse runs of one shape; the centralised filter and the bound of all of them run as one batch.

    skip: the share of steps left out at the start of RMSE, NEES and ratios, or of those that can be scored,
    whichever is less. MSEE starts at step 1. strongest: see `yardsticks`.
    """
    beside = yardsticks(traces, strongest=strongest), centralized_paths(traces)
    errors = [errors_of(trace, found, skip, path) for trace, found, path in zip(traces, *beside, strict=True)]
    return [Analysis(**vars(one), metrics=_metrics(one)) for one in errors]


def notes(metrics: Metrics) -> list[str]:
    """Notes on a run for its reader, in sentences: what is not scored or not observable, slow processes, bad data."""
    said = unseen_note(metrics.unobservable_steps), _twin_note(metrics), slow_note(metrics.slow), metrics.misfit
    return [*metrics.lacks, *filter(None, (*said, bound_note(metrics.ratio_to_bound)))]


def _twin_note(metrics: Metrics) -> str:
    """A sentence where the ratio to the centralised filter says nothing, else empty."""
    lost, reachable = metrics.centralized.position_rmse, metrics.strong.position_rmse
    if not metrics.twin_lost or lost is None or reachable is None:
        return ""
    beside = f"position RMSE {number(lost, 'm')}, where {number(reachable, 'm')} can be reached"
    return f"the centralised filter lost the target itself ({beside}): look at ratio_to_strong, not at the ratio to it"


def counted_agents(trace: Trace) -> Bools:
    """Which agents averages are over, (n,): a misbehaving one says nothing about the others; all, if none is left."""
    wrong = {agent for fault in trace.scenario.fault if isinstance(fault, SenderFault) for agent in fault.agents}
    counted = np.array([agent not in wrong for agent in range(len(trace.estimates))])
    return counted if counted.any() else np.ones_like(counted)


def errors_of(trace: Trace, beside: Yardsticks, skip: float, path: Floats | None = None) -> Errors:
    """The errors of a trace. skip: see `analyze`. path: of the centralised smoother, (K, 6), where it is smoothed.

    Those of a step rest on that step alone, but running means do not.
    """
    states, bound = beside.centralized, beside.bound
    error, reference = (_estimated_only(trace, each - trace.truth) for each in (trace.estimates, states))
    positions = trace.estimates[:, :, :3]
    counted = counted_agents(trace)
    present = np.isfinite(positions).all(axis=2) & counted[:, None]
    number = np.maximum(present.sum(axis=0), 1)
    middle = np.where(present[:, :, None], positions, 0.0).sum(axis=0) / number[:, None]
    apart = np.where(present, np.sum((positions - middle) ** 2, axis=2), 0.0)
    kept = trace.plan.space.kept
    msee = running_mean(np.sum(error**2, axis=2))
    return Errors(
        trace=trace,
        first=_first(np.asarray(np.isfinite(error[counted]).all(axis=2).any(axis=0)), skip),
        counted=counted,
        msee=msee,
        msee_average=running_mean(mean_over_agents(np.sum(error[counted] ** 2, axis=2))),
        position_error=np.linalg.norm(error[:, :, :3], axis=2),
        velocity_error=np.linalg.norm(error[:, :, 3:], axis=2),
        nees=nees_of(error[:, :, kept], trace.covariances[:, :, kept[:, None], kept]),
        nees_band=chi2_band(len(kept)),
        disagreement=np.where(present.any(axis=0), np.sqrt(apart.sum(axis=0) / number), np.nan),
        centralized_states=states,
        centralized_msee=running_mean(np.sum(reference**2, axis=1)),
        centralized_position_error=np.linalg.norm(reference[:, :3], axis=1),
        strong_states=beside.strong,
        strong_position_error=np.linalg.norm(_estimated_only(trace, beside.strong - trace.truth)[:, :3], axis=1),
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


def _estimated_only(trace: Trace, error: Floats) -> Floats:
    """Errors (..., 6) along the estimated axes; in a plane the height is given, so it is no error of the tracker's."""
    counted = np.zeros(6, dtype=bool)
    counted[trace.plan.space.kept] = True
    return np.where(counted, error, 0.0)


def _metrics(errors: Errors) -> Metrics:
    trace, window, counted = errors.trace, slice(errors.first, None), errors.counted
    share = (traffic := trace.traffic).agent_bytes / (trace.scenario.count * len(trace.time))
    quiet = _quiet_rounds(trace)
    return Metrics(
        run=trace.name,
        filter=trace.scenario.filter.kind,
        agents=trace.scenario.count,
        left_out=np.flatnonzero(~counted).tolist(),
        steps=int(estimated_steps(trace).sum()),
        seed=trace.scenario.seed,
        timing=trace.scenario.timing.mode,
        complete=trace.complete,
        stopped=trace.stopped,
        skip=errors.first,
        planar=trace.scenario.filter.planar_height is not None,
        msee=Msee([last(row) for row in errors.msee], last(errors.msee_average)),
        scored=_scored(errors),
        lacks=lacks(trace),
        unobservable_steps=stretches(unseen_steps(trace)),
        position_rmse=(own := rms(errors.position_error[counted, window])),
        velocity_rmse=rms(errors.velocity_error[counted, window]),
        claimed_position_error=rms(claimed_position_error(trace)[counted, window]),
        centralized=(twin := _yardstick(errors, errors.centralized_states, window)),
        ratio_to_centralized=ratio_to_centralized(errors, window),
        strong=(strong := _yardstick(errors, errors.strong_states, window)),
        ratio_to_strong=_ratio(errors, errors.strong_position_error, window),
        lost=_lost(own, strong),
        twin_lost=_lost(twin.position_rmse, strong),
        bound=_bound(errors, window),
        ratio_to_bound=_ratio(errors, errors.bound_position_error, window),
        smoothed=None if errors.smoothed is None else smoothing_of(errors.smoothed, trace, errors.first, counted),
        nees=(nees := _nees(errors)),
        nis=_nis(errors),
        status=standing_of(trace, errors.position_error, errors.nees, counted),
        misfit=misfit_note(trace, errors.first, nees) if trace.scenario.target.motion == "dataset" else "",
        bias=bias_of(trace, errors.first),
        distrust=distrust_of(trace, errors.first),
        slow=slowness(trace),
        disagreement=rms(errors.disagreement[window]),
        bytes_per_step=None if traffic.agents_missing else share or None,
        link_bytes_per_step=link_bytes(trace.plan, silent=quiet) or None,
        precision=trace.scenario.consensus.precision,
        silent=quiet / max(1, trace.plan.rounds) if trace.scenario.consensus.trigger else None,
        messages=Messages(traffic.sent, traffic.recorded, traffic.missing, traffic.rejected),
        gaps=traffic.gaps,
        links=links_of(trace.links),
        links_total=totals_of(trace.links),
    )


def _quiet_rounds(trace: Trace) -> float:
    """In how many rounds of a step an agent kept silent, mean."""
    silent = trace.diagnostics.silent
    return float(np.nanmean(silent)) if np.isfinite(silent).any() else 0.0


def _yardstick(errors: Errors, states: Floats, window: slice) -> Yardstick:
    """What a filter's states (K, 6) reach."""
    error = _estimated_only(errors.trace, states - errors.trace.truth)
    return Yardstick(
        position_rmse=rms(np.linalg.norm(error[window, :3], axis=1)),
        velocity_rmse=rms(np.linalg.norm(error[window, 3:], axis=1)),
        msee=last(running_mean(np.sum(error**2, axis=1))),
    )


def _bound(errors: Errors, window: slice) -> Yardstick:
    bound = np.diagonal(errors.bound[window], axis1=1, axis2=2)
    return Yardstick(
        position_rmse=rms(np.sqrt(bound[:, :3].sum(axis=1))),
        velocity_rmse=rms(np.sqrt(bound[:, 3:].sum(axis=1))),
        msee=last(errors.bound_msee),
    )


def ratio_to_centralized(errors: Errors, window: slice) -> float | None:
    """Of the position RMSEs of the network and of the centralised filter, over the same steps of a window."""
    return _ratio(errors, errors.centralized_position_error, window)


def _lost(reached: Number, strong: Yardstick) -> bool:
    """Whether a filter with this position RMSE lost the target, which the strong yardstick did not."""
    return bool((reached or 0.0) > LOST * (strong.position_rmse or np.inf))


def _ratio(errors: Errors, yardstick: Floats, window: slice) -> float | None:
    """Of the network's position RMSE and a yardstick's, whose errors are (K,), over the same steps of a window."""
    other_errors, network = yardstick[window], errors.position_error[errors.counted, window]
    own, other = rms(network[:, np.isfinite(other_errors)]), rms(other_errors[np.isfinite(network).any(axis=0)])
    return own / other if own is not None and other else None


def _scored(errors: Errors) -> Scored:
    inside = np.arange(len(errors.trace.time)) >= errors.first
    known = np.isfinite(errors.position_error) & errors.counted[:, None] & inside
    return Scored(
        agents=np.flatnonzero(known.any(axis=1)).tolist(),
        steps=stretches(np.asarray(known.any(axis=0))),
        centralized_steps=stretches(np.asarray(np.isfinite(errors.centralized_position_error) & inside)),
    )


def _nees(errors: Errors) -> Honesty | None:
    degrees = np.full(errors.nees.shape, len(errors.trace.plan.space.kept))
    return described(errors.nees, degrees, time=errors.trace.time, first=errors.first, counted=errors.counted)


def _nis(errors: Errors) -> Nis | None:
    trace, first, told = errors.trace, errors.first, errors.trace.diagnostics
    found = described(told.nis, told.nis_degrees, time=trace.time, first=first, counted=errors.counted)
    return None if found is None else Nis(**vars(found), agents_band=agents_bands(told.nis_degrees, first))
