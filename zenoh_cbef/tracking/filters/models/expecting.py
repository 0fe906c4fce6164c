"""What hypotheses expect of a range, and how likely it then is right, or wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.rows import Rows
from zenoh_cbef.tracking.outliers import UNTOLD, wrong_by_any


@dataclass(frozen=True)
class Expected:
    """What k branches expect of a range, arrays (n, k).

    row: (n, k, d), the squared range's derivative, and cross: (n, k, d), the covariance times it. distance, m, and its
    variance, m^2, without the noise. excess: the squared range over what is expected, m^2. total: the variance of that,
    m^4. unit: 2 l, m, by which it is divided to be an innovation of the range. beyond: m, by how much the range is
    longer if it is wrong, and around: m^2, the variance of that.
    """

    row: Floats
    cross: Floats
    distance: Floats
    variance: Floats
    excess: Floats
    total: Floats
    unit: Floats
    beyond: Floats
    around: Floats


@dataclass(frozen=True)
class Bias:
    """What k branches know of the bias of a range, arrays (n, k); zeros where it has none.

    mean, m, variance, m^2, and twice the covariance with the distance, m^2. column: of a state, for each of n agents.
    """

    mean: Floats
    variance: Floats
    shared: Floats
    column: tuple[Rows, Rows] | None = None


def likelihoods(
    told: Expected, noise: Floats, outliers: tuple[float, float] | None, untold: Floats | None = None
) -> tuple[Floats, Floats]:
    """Logarithms of how likely a range is that is right, and one that is wrong, (n, k).

    noise: its variance, m^2. untold: see `Branches.share`.
    """
    share, mean = UNTOLD if outliers is None else outliers
    variance, innovation = told.total / told.unit**2, told.excess / told.unit
    right = -0.5 * (innovation**2 / variance + np.log(2.0 * np.pi * variance))
    long = mean if outliers is not None else mean * np.sqrt(noise)
    innovation, variance = told.beyond, told.around
    if untold is not None:
        wrong = _wrong(innovation, variance, long, told=outliers is not None)
        chance = untold if outliers is None else np.full_like(untold, share)
        return right + np.log1p(-chance), wrong + np.log(chance)
    right = np.log1p(-share) + right
    if outliers is not None:
        short = np.minimum(innovation, 0.0) ** 2 / variance
        return right, np.log(share / mean) - np.maximum(innovation, 0.0) / mean - 0.5 * short
    return right, np.log(0.5 * share / long) - np.abs(innovation) / long


def _wrong(innovation: Floats, variance: Floats, mean: Floats | float, *, told: bool) -> Floats:
    """Logarithm of the density of a wrong range's innovation, (n, k), whatever the place's variance (m^2) in it.

    mean: of the error, m. told: whether errors are exponential; others: see `wrong_by_any`.
    """
    if not told:
        return wrong_by_any(innovation, variance, mean)
    half = np.sqrt(0.5 * np.pi * variance)
    longer = mean + half
    short = np.minimum(innovation, 0.0) ** 2 / variance
    return np.asarray(-np.log(longer + half) - np.maximum(innovation, 0.0) / longer - 0.5 * short)
