"""Range noise learned online: every agent learns its own receiver's noise from its own innovations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.ranging import Measurement

_MEDIAN = 0.67448975
"""Median of |v| for v ~ N(0, 1)."""

_SLOWEST = 0.02
"""Least step of the logarithm of sigma."""

_WIDEST = 30.0
"""By what factor sigma may leave where it began."""


@dataclass(frozen=True)
class LearnedNoise(Wrapping):
    """Stochastic approximation (Robbins and Monro, 1951) of the noise at which half of the innovations are small.

    For emulated and live ranges; for recorded ones see lasting_errors.py.

        log sigma <- log sigma + g f (1[z^2/S > 0.6745^2] - 1/2) 2,   f = sigma^2/S,  g = max(1/(1 + m/5), 0.02)

    Of Gaussian innovations z of variance S half are larger than 0.6745 of their standard deviation. A median does
    not depend on how large outliers are: with 30 % outliers sigma is too large by a factor 1.6 only. Where the
    innovation says more of the state than of the range, f is small, and sigma changes little. m: ranges so far.

    initial_std: sigma to begin with (m). outliers: what share of the ranges the scenario tells to be too long: then a
    half of the others is small, so a small one weighs (1 + p)/(1 - p) times as much as a large one.
    """

    initial_std: float
    outliers: float = 0.0

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update with the noise known so far; kept: the noise known after it."""
        inner = belief.parts[0] if belief.parts else belief
        count = len(belief.state)
        scale, seen = belief.memory or (np.zeros(count), np.zeros(count))
        std = self.initial_std * np.exp(scale)
        update = self.filter.update(inner, replace(measurement, range_std=std))
        told = update.diagnostics
        after = learned(scale, seen, std, told.innovation, told.nis, outliers=self.outliers)
        return replace(update, kept=after, parts=(update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief."""
        inner = self.filter.conclude(payload, update.parts[0])
        return Belief(inner.state, inner.covariance, inner.bias, update.kept, (inner,))


def learned(
    scale: Floats, seen: Floats, std: Floats, innovation: Floats, nis: Floats, *, outliers: float = 0.0
) -> tuple[Floats, Floats]:
    """Log sigma/initial and number of ranges after an update, (n,); std: (n,), m, with which it was made."""
    usable = nis > 0.0
    nis = np.where(usable, nis, 1.0)
    share = np.where(usable, std**2 * nis / np.where(usable, innovation, 1.0) ** 2, 0.0)
    gain = np.maximum(1.0 / (1.0 + seen / 5.0), _SLOWEST)
    step = gain * np.minimum(share, 1.0) * np.where(nis > _MEDIAN**2, 1.0, -(1.0 + outliers) / (1.0 - outliers))
    limit = np.log(_WIDEST)
    return np.clip(scale + step, -limit, limit), seen + usable
