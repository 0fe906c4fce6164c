"""Consistency of the covariance: NEES and NIS against the chi-squared distribution, per agent and over time.

NEES is the error in units of the covariance that the agent claims, and needs the truth. NIS is the innovation in
units of the covariance that the filter predicted for it, and needs no truth. For a consistent filter both are
chi-squared (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from zenoh_cbef.analysis.averages import means, middle, told
from zenoh_cbef.analysis.chi2 import chi2_quantile
from zenoh_cbef.analysis.results import Honesty, OverTime
from zenoh_cbef.arrays import Bools, Floats, Ints

_STRETCHES = 20


def chi2_band(degrees: float, count: int = 1) -> tuple[float, float]:
    """Where the mean of `count` independent chi-squared values of so many degrees lies with 95 % probability."""
    total = degrees * count
    return chi2_quantile(0.025, total) / count, chi2_quantile(0.975, total) / count


def nees_of(error: Floats, covariance: Floats) -> Floats:
    """e^T P^-1 e of errors (n, K, s) and covariances (n, K, s, s); NaN where either is not known."""
    known = np.asarray(np.isfinite(covariance).all(axis=(2, 3)))
    safe = covariance if known.all() else np.where(known[:, :, None, None], covariance, np.eye(error.shape[2]))
    scaled = np.linalg.solve(safe, np.nan_to_num(error)[..., None])[..., 0]
    return np.where(known, np.sum(error * scaled, axis=2), np.nan)


def described(values: Floats, degrees: Ints, *, time: Floats, first: int, counted: Bools) -> list[Honesty | None]:
    """What the metrics say of a statistic of r runs, (r, n, K), with degrees of freedom (r, n, K), 0 or more.

    None for a run that has none. The window begins at index `first`; over time there are at most twenty stretches.
    time: (K,), s. counted: (n,), the agents that average and inside are over.
    """
    window, runs = values[:, :, first:], len(values)
    ends = np.unique(np.linspace(0, len(time), min(_STRETCHES, len(time)) + 1).astype(int))
    stretches = [slice(start, end) for start, end in pairwise(ends.tolist())]
    usual = middle(np.where(np.isfinite(window), degrees[:, :, first:], np.nan).reshape(runs, -1))
    average = means(window[:, counted].reshape(runs, -1))
    over_time = np.stack([means(values[:, :, one]) for one in stretches], axis=2)
    inside = _shares_inside(values[:, counted], degrees[:, counted], [slice(first, None), *stretches])
    parts = (told(part) for part in (usual, average, means(window), over_time, inside))
    until = [float(time[end - 1]) for end in ends[1:]]
    return [
        None
        if dimension is None
        else Honesty(
            average=mean,
            agents=agents,
            dimension=int(dimension) if dimension.is_integer() else dimension,
            band=list(chi2_band(dimension)),
            inside=share,
            over_time=OverTime(until, each, shares),
        )
        for dimension, mean, agents, each, (share, *shares) in zip(*parts, strict=True)
    ]


def agents_bands(degrees: Ints, first: int) -> list[list[float] | None]:
    """Where each agent's mean NIS over the window lies with 95 % probability, as innovations are white."""
    bands: list[list[float] | None] = []
    for row in degrees[:, first:]:
        count = int((row > 0).sum())
        bands.append(list(chi2_band(float(row.sum()) / count, count)) if count else None)
    return bands


def trailing_mean(values: Floats, degrees: Ints, steps: int) -> Floats:
    """Statistic per degree of freedom, (n, K), averaged over the last `steps` steps; NaN where there is no value."""
    known = np.isfinite(values)

    def summed(parts: Floats) -> Floats:
        return np.asarray(sliding_window_view(np.pad(parts, ((0, 0), (steps - 1, 0))), steps, axis=1).sum(axis=2))

    count = summed(np.where(known, degrees, 0).astype(np.float64))
    return np.where(known, summed(np.where(known, values, 0.0)) / np.maximum(count, 1.0), np.nan)


def _shares_inside(values: Floats, degrees: Ints, stretches: Sequence[slice]) -> Floats:
    """Which share of the values (r, n, K) of some stretches of steps is in the band of its degrees, (r, stretches)."""
    inside, known = np.zeros(values.shape, dtype=bool), np.isfinite(values)
    for each in np.unique(degrees[known]).tolist():
        low, high = chi2_band(each)
        inside |= (degrees == each) & (values >= low) & (values <= high)
    hits, count = (
        np.stack([steps[:, one].sum(axis=1) for one in stretches], axis=1)
        for steps in ((inside & known).sum(axis=1), known.sum(axis=1))
    )
    return np.where(count > 0, hits / np.maximum(count, 1), np.nan)
