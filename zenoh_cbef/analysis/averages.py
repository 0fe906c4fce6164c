"""Averages of values of which some are missing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.analysis.results import Number


def mean(values: NDArray[np.float64]) -> Number:
    """The mean of the finite values; None for nothing."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else None


def rms(values: NDArray[np.float64]) -> Number:
    """The root of their mean square."""
    square = mean(values**2)
    return None if square is None else float(np.sqrt(square))
