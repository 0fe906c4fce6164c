"""What a range tells of its distance, if a share of the ranges is wrong."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace

UNTOLD = 0.02, 50.0
"""The share of ranges taken to be wrong where nothing is told of it, and by how much on average, in their noises."""

_ERFC = (
    *(-1.26551223, 1.00002368, 0.37409196, 0.09678418, -0.18628806),
    *(0.27886807, -1.13520398, 1.48851587, -0.82215223, 0.17087277),
)


@dataclass(frozen=True)
class Informed:
    """What ranges tell of their distances: pull, 1/m, precision, 1/m^2, and cost, arrays of one shape.

    cost: -2 log of how likely a range is at the predicted distance itself, less what follows from pull and precision.
    """

    pull: Floats
    precision: Floats
    cost: Floats

    def weight(self, noise: Floats) -> Floats:
        """What is left of what ranges of this noise, m^2, would tell without outliers, from 0 to 1."""
        return self.precision * noise


@dataclass(frozen=True)
class Errors(ABC):
    """How wrong ranges are distributed. share: how many are wrong, or for each agent how likely its range is, (n,)."""

    share: float | Floats

    def among(self, wrong: Floats | None) -> Self:
        """The same, where a range is as likely wrong as that, (n,); None: as it is."""
        return self if wrong is None else replace(self, share=wrong)

    @abstractmethod
    def informed(self, innovation: Floats, spread: Floats, noise: Floats) -> Informed:
        """Of ranges with innovations (m) of a predicted standard deviation (m), with the noise's variance (m^2)."""


@dataclass(frozen=True)
class Outliers(Errors):
    """A share p of all ranges that is too long by exponential errors of mean m, of which a scenario tells.

        f(z) = (1 - p) N(z; 0, S) + p w(z),      w = N(0, S) + an exponential error of mean m,   S = H P H^T + sigma^2
        g = -(log f)',   J = -(log f)''          the mean of the distance moves by C g, its variance C becomes C - C^2 J
        precision U = J/(1 - C J),               pull = g (1 + C U),              C = H P H^T

    These moments are exact for one range (Masreliez, IEEE TAC 20(1), 1975). An outlier that is larger than noise and
    prior counts for nothing; one that is not makes a range less sure and, as all are too long, pulls to the short side.
    Between the two J may be below zero: the range leaves the distance less sure than it was. There U = 0, as what all
    agents add up has to stay positive definite.

    share: p. mean: m, m.
    """

    mean: float

    def informed(self, innovation: Floats, spread: Floats, noise: Floats) -> Informed:
        """Of ranges with innovations (m) of a predicted standard deviation (m), with the noise's variance (m^2)."""
        total, share = spread**2, self.share
        prior = total - noise
        gauss, wrong, exponent = _densities(innovation, total, self.mean)
        density = (1.0 - share) * gauss + share * wrong
        slope, rise = -innovation / total * gauss, (gauss - wrong) / self.mean
        bend = (1.0 - share) * (innovation**2 / total - 1.0) / total * gauss + share * (slope - rise) / self.mean
        score = -((1.0 - share) * slope + share * rise) / density
        curvature = np.clip(score**2 - bend / density, 0.0, 1.0 / total)
        precision = curvature / (1.0 - prior * curvature)
        grows = 1.0 + prior * precision
        cost = score**2 * prior * grows - np.log(grows) - 2.0 * (np.log(density) - exponent)
        return Informed(score * grows, precision, cost)


@dataclass(frozen=True)
class Untold(Errors):
    """A few ranges are wrong, by errors of some size m and either sign, of which a scenario says nothing.

        R = sigma^2 max(1, |z|/(xi sqrt S))      a range that saturates has so much noise,  S = C + sigma^2
        f(z) = (1 - p) N(z; 0, C + R) + p w(z),  w: see `wrong_by_any`,     p = 0.02,   m = 50 sigma,   C = H P H^T
        right = (1 - p) N(z; 0, C + R)/f(z)      precision U = right/R,     pull = U z

    So ranges saturate as where none are wrong, and one that is far off even so counts as much as it is likely right, as
    in a step of expectation maximisation (Dempster, Laird and Rubin, J. R. Stat. Soc. B 39(1), 1977). The moments of
    one range's posterior, as those of `Outliers`, would not do: one that is right with 0.99 leaves a wide prior's
    variance times 0.01, far more than its noise, while all ranges of a step together leave no doubt.

    share: p. size: m, m. xi: standard deviations of the innovation at which ranges saturate. bursts: whether agents
    learn how likely a range is wrong, from those before it.
    """

    size: float
    xi: float
    bursts: bool = False

    @classmethod
    def of(cls, range_std: float, xi: float, *, bursts: bool = False) -> Self:
        """Those of receivers with this noise, m."""
        share, noises = UNTOLD
        return cls(share, noises * range_std, xi, bursts)

    def informed(self, innovation: Floats, spread: Floats, noise: Floats) -> Informed:
        """Of ranges with innovations (m) of a predicted standard deviation (m), with the noise's variance (m^2)."""
        prior = spread**2 - noise
        noise = noise * np.maximum(np.abs(innovation) / (self.xi * spread), 1.0)
        total = prior + noise
        right = np.log1p(-self.share) - 0.5 * (innovation**2 / total + np.log(2.0 * np.pi * total))
        wrong = np.log(self.share) + wrong_by_any(innovation, spread**2, self.size)
        # logaddexp would warn of a range that is missing.
        density = np.maximum(right, wrong) + np.log1p(np.exp(-np.abs(right - wrong)))
        precision = np.exp(right - density) / noise
        pull = precision * innovation
        grows = 1.0 + prior * precision
        return Informed(pull, precision, pull**2 * prior / grows - np.log(grows) - 2.0 * density)


def wrong_by_any(innovation: Floats, variance: Floats, size: Floats | float) -> Floats:
    """Logarithm of the density of a wrong range's innovation, whatever the place's variance (m^2) in it.

        w(z) = (1 + |z|/m')^-2/(2 m'),     m' = m + sqrt(pi S/2)

    Without that variance in it, a place of which little is known would make all ranges likelier wrong than right.
    size: of the error, m, m; half of the normal density of the place lies on either side.
    """
    longer = size + np.sqrt(0.5 * np.pi * variance)
    return np.asarray(-np.log(2.0 * longer) - 2.0 * np.log1p(np.abs(innovation) / longer))


def _densities(value: Floats, variance: Floats, mean: float) -> tuple[Floats, Floats, Floats]:
    """Densities of N(0, variance), and of that with an exponential error, at values, m: both times exp of the third."""
    std = np.sqrt(variance)
    place = (std / mean - value / std) / np.sqrt(2.0)
    tail, before = _scaled_erfc(np.abs(place)), place >= 0.0
    # exp(-a^2) is what the normal density has less than the exponential one.
    fades = np.exp(-np.where(before, 0.0, place * place))
    wrong = np.where(before, tail, 2.0 - fades * tail) / (2.0 * mean)
    exponent = np.where(before, 0.5 * value**2 / variance, value / mean - 0.5 * variance / mean**2)
    return fades / (std * np.sqrt(2.0 * np.pi)), wrong, exponent


def _scaled_erfc(place: Floats) -> Floats:
    """exp(x^2) erfc(x) for x >= 0, to 1.2e-7 of it (Press et al., Numerical Recipes, section 6.2)."""
    short = 1.0 / (1.0 + 0.5 * place)
    power = np.zeros_like(short)
    for factor in reversed(_ERFC):
        power = power * short + factor
    return np.asarray(short * np.exp(power))
