"""Errors of runs without the yardsticks beside them, which take longer than the runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef.analysis.errors import Errors, errors_of
from zenoh_cbef.analysis.yardsticks import Yardsticks, centralized_run
from zenoh_cbef.arrays import Floats
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking.reference import stacked

SKIP = 0.25
"""The share of steps that `analyze` leaves out, too."""


def errors(traces: Sequence[Trace]) -> list[Errors]:
    """What `analyze` finds of these runs without a centralised filter and a bound: those are NaN."""
    return [errors_of(trace, _unknown(trace), SKIP) for trace in traces]


def position_rmse(run: Errors) -> float:
    """As in the metrics of `analyze`, m."""
    return float(np.sqrt(np.nanmean(run.position_error[run.counted, run.first :] ** 2)))


def nees(run: Errors) -> float:
    """The average of the metrics of `analyze`."""
    return float(np.nanmean(run.nees[run.counted, run.first :]))


def centralised(traces: Sequence[Trace]) -> Floats:
    """States (r, K, 6) of the centralised filter alone, as the yardsticks have them."""
    return stacked(traces[0].plan.space, centralized_run(traces, traces[0].plan.scenario.length))[0]


def ratios_to_centralised(traces: Sequence[Trace]) -> list[float]:
    """Of the networks' position errors to those of the centralised filter, over the same steps."""
    found = []
    for run, state in zip(errors(traces), centralised(traces), strict=True):
        square = np.sum((state - run.trace.truth)[run.first :, :3] ** 2, axis=1)
        found.append(position_rmse(run) / float(np.sqrt(square.mean())))
    return found


def _unknown(trace: Trace) -> Yardsticks:
    nothing = np.full(trace.truth.shape, np.nan)
    return Yardsticks(nothing, nothing, np.full((*trace.truth.shape, 6), np.nan))
