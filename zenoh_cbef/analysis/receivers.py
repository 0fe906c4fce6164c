"""What agents found out about their own receivers."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.analysis.averages import last, mean
from zenoh_cbef.analysis.results import Bias, Distrust
from zenoh_cbef.trace import Trace

FLAGGED = 0.5
"""Distrust from which on an agent's receiver counts as flagged."""


def bias_of(trace: Trace, first: int) -> Bias | None:
    """The biases of ranges; None for a filter that does not estimate them. first: index of the first scored step."""
    told = trace.diagnostics
    if not np.isfinite(told.bias).any():
        return None
    return Bias(
        agents=[last(row) for row in told.bias],
        std=[last(row) for row in told.bias_std],
        weight=[mean(row) for row in told.bias_weight[:, first:]],
    )


def distrust_of(trace: Trace, first: int) -> Distrust | None:
    """How often agents distrusted their ranges; None where they never ask. first: index of the first scored step."""
    distrust = trace.diagnostics.distrust
    if not np.isfinite(distrust).any():
        return None
    known, flagged = np.isfinite(distrust), distrust > FLAGGED
    return Distrust(
        agents=[mean(row) for row in np.where(known, flagged, np.nan)[:, first:]],
        first=[float(trace.time[row.argmax()]) if row.any() else None for row in flagged],
        last=[float(trace.time[len(row) - 1 - row[::-1].argmax()]) if row.any() else None for row in flagged],
    )
