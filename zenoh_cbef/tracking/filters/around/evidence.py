"""What innovations say for an estimated bias of the ranges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats

Innovations = tuple[Floats, Floats]
"""Sizes of innovations, m, and their NIS, arrays of one shape; NaN where nothing was measured."""

LARGEST = 4.0
"""Where a NIS is cut off, so that outliers, which neither filter explains, do not decide."""

MEMORY, BEGIN = 2000.0, 50.0
"""How many of the network's ranges the weighing remembers, and how many consistent ones it begins with."""

_GAIN = (0.25, 0.45)
"""Mean of twice the gained log likelihood of a range from which on a bias is believed, and at which it is fully."""

_INCONSISTENT = (0.8, 1.0)
"""Mean cut NIS of the plain filter from which on it is doubted, and at which it is fully; 0.92 for Gaussian noise."""

_EXPLAINED = (1.05, 1.25)
"""How many times the biased filter's NIS the plain filter's must be, likewise, for the bias to explain the excess."""


_TIMES = (3.0, 4.0)
"""How many times the biased filter's cost the plain filter's must be, likewise, whatever noise was told."""

_FOLLOWED = 0.1
"""Least share of that gain of which errors that last are taken to be the reason."""

_SMALL = 0.02
"""With which cost the ranges begin that the weighing begins with, so that they hide no such ratio for long."""


@dataclass(frozen=True)
class Evidence:
    """Sums over the network's last ranges (..., 3): what each filter makes of a range, and how many there were.

    With likelihoods, the filters' likelihoods of every range are compared, z ~ N(0, S) with a cut square:

        l_0 = min(z_0^2/S_0, 4) + ln(S_0/S_1),  l_1 = min(z_1^2/S_1, 4)      plain and biased, twice -ln(likelihood)
        weight = step(mean l_0 - mean l_1; 0.25, 0.45)

    A filter with more states follows slow errors of ranges too, and then always gains a little; a bias gains more. Of
    an overstated noise this takes nothing but scale, so a bias shows where the plain filter is not yet inconsistent.

    Where the noise is overstated by far, a bias hides in it: all squares are small, and so is what is gained. So with
    `ratios` a bias is believed, too, that takes away most of what misfits. Following slow errors takes away less.

        weight = max(the same, step(mean l_0/mean l_1; 3, 4))

    Without likelihoods, as in version 0.2.0, l_0 and l_1 are the cut squares alone, and a plain filter is kept as long
    as its mean is plausible for the noise that was given, which hides a bias where that is overstated:

        weight = step(mean l_0; 0.8, 1) step(mean l_0/mean l_1; 1.05, 1.25)

    Slow errors are followed as far as they last: a range then gains -ln(1 - c^2) at most, where c is the correlation of
    an error with those before it. So with `lasting` a gain counts the more, the less alike errors are:

        l_0, l_1 of agent i are divided by clip(-ln(1 - c_i^2), 0.1, 1)

    With `squares` the second factor alone decides, whatever noise was told, as between two filters with biases: slow
    errors are followed by both. The position absorbs most of what is wrong with all ranges, so that shows little in
    innovations, and for that long. With `lasting`, too, it counts the more, the less alike errors are:

        l_0 of agent i is l_1 + (l_0 - l_1)/clip(-ln(1 - c_i^2), 0.1, 1)

    step(x; a, b): smooth, 0 up to a and 1 from b on.
    """

    likelihoods: bool = True
    ratios: bool = False
    squares: bool = False
    lasting: bool = False

    @property
    def least(self) -> Floats:
        """The least that an average of the three may be: none is below zero, but what a share of all ranges gains."""
        return np.array([-np.inf if self.squares and self.lasting else 0.0, 0.0, 0.0])

    def begun(self, count: int) -> Floats:
        """The sums before the first range, (n, 3)."""
        sums = np.full((count, 3), BEGIN)
        if self.ratios:
            sums[:, :2] *= _SMALL
        return sums

    def of(self, plain: Innovations, biased: Innovations, alike: Floats | None = None) -> Floats:
        """What ranges say: l_0, l_1 and 1 where there was one, otherwise zeros; (..., 3).

        alike: correlations of errors with those before them, below 1, (...); None: not known.
        """
        first, second = (np.nan_to_num(nis) for _, nis in (plain, biased))
        gained = np.zeros_like(first)
        if self.likelihoods:
            usable = (first > 0.0) & (second > 0.0)
            squares = (np.where(usable, size, 1.0) ** 2 for size, _ in (plain, biased))
            variances = [
                square / np.where(usable, nis, 1.0) for square, nis in zip(squares, (first, second), strict=True)
            ]
            gained = np.where(usable, np.log(variances[0]) - np.log(variances[1]), 0.0)
        # On whichever side leaves both sums positive, as counts are.
        cut = (
            np.minimum(first, LARGEST) + np.maximum(gained, 0.0),
            np.minimum(second, LARGEST) - np.minimum(gained, 0.0),
        )
        if self.lasting and alike is not None:
            followed = np.clip(-np.log(1.0 - alike**2), _FOLLOWED, 1.0)
            if self.squares:
                cut = cut[1] + (cut[0] - cut[1]) / followed, cut[1]
            else:
                cut = cut[0] / followed, cut[1] / followed
        return np.stack([*cut, np.isfinite(plain[1]).astype(np.float64)], axis=-1)

    def weight(self, sums: Floats) -> Floats:
        """Weight of the biased filter, (...)."""
        plain, biased = sums[..., 0] / sums[..., 2], sums[..., 1] / sums[..., 2]
        if self.likelihoods:
            gained = step(plain - biased, *_GAIN)
            return np.maximum(gained, step(plain / biased, *_TIMES)) if self.ratios else gained
        explained = step(plain / biased, *_EXPLAINED)
        return explained if self.squares else step(plain, *_INCONSISTENT) * explained


SQUARES = Evidence(likelihoods=False, ratios=True, squares=True)
"""Between two filters with biases."""


def step(value: Floats, low: float, high: float) -> Floats:
    """Smooth, 0 up to `low` and 1 from `high` on."""
    way = np.clip((value - low) / (high - low), 0.0, 1.0)
    return np.asarray(way * way * (3.0 - 2.0 * way))
