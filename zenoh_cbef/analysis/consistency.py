"""Consistency of the covariance: NEES and NIS against the chi-squared distribution, per agent and over time.

NEES is the error in units of the covariance that the agent claims, and needs the truth. NIS is the innovation in
units of the covariance that the filter predicted for it, and needs no truth. For a consistent filter both are
chi-squared (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from zenoh_cbef.analysis.averages import mean
from zenoh_cbef.analysis.chi2 import chi2_quantile
from zenoh_cbef.analysis.results import Honesty, Number, OverTime
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


def described(values: Floats, degrees: Ints, *, time: Floats, first: int, counted: Bools) -> Honesty | None:
    """What the metrics say of a statistic (n, K) with degrees of freedom (n, K), 0 or more; None where it has none.

    The window begins at index `first`; over time there are at most twenty stretches. time: (K,), s. counted: (n,),
    the agents that average and inside are over.
    """
    known = np.isfinite(values)
    if not known[:, first:].any():
        return None
    usual = float(np.median(degrees[:, first:][known[:, first:]]))
    inside, whole = _inside(values, degrees)[counted], bool(known.all())
    ends = np.unique(np.linspace(0, len(time), min(_STRETCHES, len(time)) + 1).astype(int))
    stretches = [slice(start, end) for start, end in pairwise(ends.tolist())]
    return Honesty(
        average=mean(values[counted, first:]),
        agents=_means(values[:, first:], whole=whole),
        dimension=int(usual) if usual.is_integer() else usual,
        band=list(chi2_band(usual)),
        inside=mean(inside[:, first:]),
        over_time=OverTime(
            until=[float(time[end - 1]) for end in ends[1:]],
            agents=[
                list(each) for each in zip(*(_means(values[:, one], whole=whole) for one in stretches), strict=True)
            ],
            inside=[mean(inside[:, stretch]) for stretch in stretches],
        ),
    )


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


def _inside(values: Floats, degrees: Ints) -> Floats:
    """1 where a value lies in the band of its own degrees of freedom, 0 where not, NaN where there is none."""
    inside, known = np.full(values.shape, np.nan), np.isfinite(values)
    for each in np.unique(degrees[known]).tolist():
        low, high = chi2_band(each)
        inside = np.where(known & (degrees == each), (values >= low) & (values <= high), inside)
    return inside


def _means(values: Floats, *, whole: bool) -> list[Number]:
    """The mean of each row of (n, k); whole: where no value is missing."""
    if whole:
        means: list[Number] = (np.add.reduce(values, axis=1) / values.shape[1]).tolist()
        return means
    return [mean(row) for row in values]
