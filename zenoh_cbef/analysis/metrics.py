"""The metrics of a run: the paper's MSEE, errors against the centralised filter and the bound, consistency, traffic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.analysis.averages import last, means, ratio_of_rms, rms, running_mean, told
from zenoh_cbef.analysis.below import bound_note
from zenoh_cbef.analysis.claimed import claimed_position_error
from zenoh_cbef.analysis.consistency import agents_bands, described
from zenoh_cbef.analysis.coverage import estimated_steps, lacks, stretches, unseen_note
from zenoh_cbef.analysis.demand import link_bytes
from zenoh_cbef.analysis.errors import Errors, errors_of, estimated_only
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
    Stretches,
    Yardstick,
)
from zenoh_cbef.analysis.slowness import slow_note, slowness
from zenoh_cbef.analysis.smoothed import centralized_paths, smoothing_of
from zenoh_cbef.analysis.standing import standing_of
from zenoh_cbef.analysis.verdict import OVERCONFIDENT
from zenoh_cbef.analysis.yardsticks import yardsticks
from zenoh_cbef.arrays import Floats, Ints
from zenoh_cbef.numbers import SKIPPED, number
from zenoh_cbef.trace import Trace

LOST = 3.0
"""From how many times the strong yardstick's position RMSE on a filter has lost the target."""


@dataclass(frozen=True)
class Analysis(Errors):
    """A trace with its errors and what they amount to."""

    metrics: Metrics


def analyze(traces: Sequence[Trace], skip: float = SKIPPED, *, strongest: bool = True) -> list[Analysis]:
    """Analyse runs of one shape; the centralised filter and the bound of all of them run as one batch.

    skip: the share of steps left out at the start of RMSE, NEES and ratios, or of those that can be scored,
    whichever is less. MSEE starts at step 1. strongest: see `yardsticks`.
    """
    beside = yardsticks(traces, strongest=strongest), centralized_paths(traces)
    errors = [errors_of(trace, found, skip, path) for trace, found, path in zip(traces, *beside, strict=True)]
    return [Analysis(**vars(one), metrics=found) for one, found in zip(errors, _metrics(errors), strict=True)]


def notes(metrics: Metrics) -> list[str]:
    """Notes on a run for its reader, in sentences: what is not scored or not observable, slow processes, bad data."""
    said = unseen_note(metrics.unobservable_steps), _twin_note(metrics), slow_note(metrics.slow)
    sure = metrics.misfit or _sureness_note(metrics)
    return [
        *metrics.lacks,
        *filter(None, (*said, sure, bound_note(metrics.ratio_to_bound, metrics.steps - metrics.skip))),
    ]


def _sureness_note(metrics: Metrics) -> str:
    """A sentence where agents are far too sure of what they estimate, although they see it, else empty."""
    nees = metrics.nees
    times = 0.0 if nees is None or nees.average is None else nees.average / nees.dimension
    if metrics.unobservable_steps or times <= OVERCONFIDENT**2:
        return ""
    return (
        f"agents are too sure of themselves: NEES is {number(times)} times its ideal, as if errors were "
        f"{number(np.sqrt(times))} times what they claim; see docs/troubleshooting.md"
    )


def _twin_note(metrics: Metrics) -> str:
    """A sentence where the ratio to the centralised filter says nothing, else empty."""
    lost, reachable = metrics.centralized.position_rmse, metrics.strong.position_rmse
    if not metrics.twin_lost or lost is None or reachable is None:
        return ""
    beside = f"position RMSE {number(lost, 'm')}, where {number(reachable, 'm')} can be reached"
    return f"the centralised filter lost the target itself ({beside}): look at ratio_to_strong, not at the ratio to it"


def _metrics(errors: Sequence[Errors]) -> list[Metrics]:
    """Those of runs of one shape; runs with the same window and the same agents that count are one batch."""
    if len({(one.first, one.counted.tobytes()) for one in errors}) > 1:
        return [found for one in errors for found in _metrics([one])]
    unseen = map(stretches, unseen_steps([one.trace for one in errors]))
    found = zip(unseen, *_yardsticks(errors), _nees(errors), _nis(errors), strict=True)
    return [_of_run(one, _Together(*parts)) for one, parts in zip(errors, found, strict=True)]


@dataclass(frozen=True)
class _Together:
    """Those metrics of a run that are found of all runs together."""

    unobservable_steps: Stretches
    centralized: Yardstick
    strong: Yardstick
    bound: Yardstick
    nees: Honesty | None
    nis: Nis | None


def _of_run(errors: Errors, found: _Together) -> Metrics:
    trace, window, counted = errors.trace, slice(errors.first, None), errors.counted
    share = (traffic := trace.traffic).agent_bytes / (trace.scenario.count * len(trace.time))
    quiet = _quiet_rounds(trace)
    return Metrics(
        **vars(found),
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
        position_rmse=(own := rms(errors.position_error[counted, window])),
        velocity_rmse=rms(errors.velocity_error[counted, window]),
        claimed_position_error=rms(claimed_position_error(trace)[counted, window]),
        ratio_to_centralized=ratio_to_centralized(errors, window),
        ratio_to_strong=_ratio(errors, errors.strong_position_error, window),
        lost=_lost(own, found.strong),
        twin_lost=_lost(found.centralized.position_rmse, found.strong),
        ratio_to_bound=_ratio(errors, errors.bound_position_error, window),
        smoothed=None if errors.smoothed is None else smoothing_of(errors.smoothed, trace, errors.first, counted),
        status=standing_of(trace, errors.position_error, errors.nees, counted),
        misfit=misfit_note(trace, errors.first, found.nees) if trace.scenario.target.motion == "dataset" else "",
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


def _yardsticks(errors: Sequence[Errors]) -> list[list[Yardstick]]:
    """What the centralised filter, the strong one, and the bound reach in r runs, one after the other."""
    space, truth = errors[0].trace.plan.space, np.stack([one.trace.truth for one in errors])
    states = (np.stack([getattr(one, part) for one in errors]) for part in ("centralized_states", "strong_states"))
    variances = np.stack([np.diagonal(one.bound, axis1=1, axis2=2) for one in errors])
    return [
        _reached(squares, errors[0].first)
        for squares in (*(estimated_only(space, each - truth) ** 2 for each in states), variances)
    ]


def _reached(squares: Floats, first: int) -> list[Yardstick]:
    """Of squared errors (r, K, 6), in the window that begins at index `first`."""
    parts = (np.sqrt(squares[:, first:, axes].sum(axis=2)) for axes in (slice(3), slice(3, 6)))
    found = (told(np.sqrt(means(each**2))) for each in parts)
    return [Yardstick(*each) for each in zip(*found, map(last, running_mean(squares.sum(axis=2))), strict=True)]


def ratio_to_centralized(errors: Errors, window: slice) -> float | None:
    """Of the position RMSEs of the network and of the centralised filter, over the same steps of a window."""
    return _ratio(errors, errors.centralized_position_error, window)


def _lost(reached: Number, strong: Yardstick) -> bool:
    """Whether a filter with this position RMSE lost the target, which the strong yardstick did not."""
    return bool((reached or 0.0) > LOST * (strong.position_rmse or np.inf))


def _ratio(errors: Errors, yardstick: Floats, window: slice) -> float | None:
    """Of the network's position RMSE and a yardstick's, whose errors are (K,), over the same steps of a window."""
    return ratio_of_rms(errors.position_error[errors.counted, window], yardstick[window])


def _scored(errors: Errors) -> Scored:
    inside = np.arange(len(errors.trace.time)) >= errors.first
    known = np.isfinite(errors.position_error) & errors.counted[:, None] & inside
    return Scored(
        agents=np.flatnonzero(known.any(axis=1)).tolist(),
        steps=stretches(np.asarray(known.any(axis=0))),
        centralized_steps=stretches(np.asarray(np.isfinite(errors.centralized_position_error) & inside)),
    )


def _nees(errors: Sequence[Errors]) -> list[Honesty | None]:
    values = np.stack([one.nees for one in errors])
    return _described(errors, values, np.full(values.shape, len(errors[0].trace.plan.space.kept)))


def _nis(errors: Sequence[Errors]) -> list[Nis | None]:
    told = [one.trace.diagnostics for one in errors]
    degrees = np.stack([one.nis_degrees for one in told])
    found = zip(_described(errors, np.stack([one.nis for one in told]), degrees), degrees, strict=True)
    return [
        None if one is None else Nis(**vars(one), agents_band=agents_bands(own, errors[0].first)) for one, own in found
    ]


def _described(errors: Sequence[Errors], values: Floats, degrees: Ints) -> list[Honesty | None]:
    one = errors[0]
    return described(values, degrees, time=one.trace.time, first=one.first, counted=one.counted)
