"""Errors of runs without the yardsticks beside them, which take longer than the runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef.analysis.metrics import Errors, errors_of
from zenoh_cbef.analysis.yardsticks import Yardsticks
from zenoh_cbef.trace import Trace

SKIP = 0.25
"""The share of steps that `analyze` leaves out, too."""


def errors(traces: Sequence[Trace]) -> list[Errors]:
    """What `analyze` finds of these runs without a centralised filter and a bound: those are NaN."""
    return [errors_of(trace, _unknown(trace), SKIP) for trace in traces]


def position_rmse(run: Errors) -> float:
    """As in the metrics of `analyze`, m."""
    return float(np.sqrt(np.nanmean(run.position_error[run.counted, run.first :] ** 2)))


def _unknown(trace: Trace) -> Yardsticks:
    nothing = np.full(trace.truth.shape, np.nan)
    return Yardsticks(nothing, nothing, np.full((*trace.truth.shape, 6), np.nan))
