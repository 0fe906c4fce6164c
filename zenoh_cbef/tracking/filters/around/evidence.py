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

_BEYOND = (1.0, 1.25)
"""How many times what following slow errors gains at most a bias must gain, likewise, whatever noise was told."""

_PRESUMED = 0.01
"""What a range gains by a bias that is presumed, where errors do not last."""

_FOLLOWED, _FOLLOWED_BEFORE = 0.02, 0.1
"""Least share of that gain of which errors that last are taken to be the reason, and by rules up to the 23rd."""

_HALF = 0.5
"""The weight of a bias of which nothing is known."""

_UNKNOWN, _SHARERS = (40.0, 80.0), 20
"""How many ranges of each agent leave half open, and none, whether errors last; of at most so many agents, as the
network remembers no more.
"""

_SMALL = 0.02
"""With which cost the ranges begin that the weighing begins with, so that they hide no such ratio for long."""


@dataclass(frozen=True)
class Evidence:
    """Sums over the network's last ranges (..., 3 or 5): what each filter makes of a range, how many, and what follows.

    With likelihoods, the filters' likelihoods of every range are compared, z ~ N(0, S) with a cut square:

        l_0 = min(z_0^2/S_0, 4) + ln(S_0/S_1),  l_1 = min(z_1^2/S_1, 4)      plain and biased, twice -ln(likelihood)
        weight = step(mean l_0 - mean l_1; 0.25, 0.45)

    A filter with more states follows slow errors of ranges too, and then always gains a little; a bias gains more. Of
    an overstated noise this takes nothing but scale, so a bias shows where the plain filter is not yet inconsistent.

    Where the noise is overstated by far, a bias hides in it: all squares are small, and so is what is gained. So with
    `ratios` a bias is believed, too, that takes away most of what misfits. Following slow errors takes away less.

        weight = max(the same, step(mean l_0/mean l_1; 3, 4))

    Real receivers have biases as a rule. To leave one alone that hardly shows makes an estimate too sure, and to
    estimate one that is none costs a hundredth where errors do not last. So with `presumes`, by today's rules where
    ranges are recorded, a bias is believed there unless it makes ranges less likely. And it is, whatever noise was
    told, where it gains more than following errors can: ln(q_0/q_1) + s, with the noise that suits either filter best.
    With q_0, q_1 and s the means of both squares and of ln(S_0/S_1), all divided by clip(-ln(1 - c_i^2), 0.02, 1), and
    with C the mean of one over that, two sums more:

        weight = max(step(q_0 - q_1 + s + 0.01 C; 0.25, 0.45), step(C ln(q_0/q_1) + s; 1, 1.25))

    With `opens` agents that do not know yet whether errors last leave open whether there is a bias: the weight of the
    biased filter is a half at least, of a mixture that claims both, until each agent has had some tens of ranges, and
    unless the bias makes these less likely.

        weight = max(the same, (1 - step(ranges/min(n, 20); 40, 80)) (1 - step(q_1 - q_0 - s; 0.25, 0.45))/2)

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
    presumes: bool = False
    opens: bool = False

    @property
    def _free(self) -> bool:
        """Whether squares and spreads are summed up apart, which tells what is gained with any noise."""
        return self.presumes and not self.squares

    @property
    def numbers(self) -> int:
        """How many sums there are."""
        return 5 if self._free else 3

    @property
    def least(self) -> Floats:
        """The least that an average of these may be: none is below zero, but what a share of all ranges gains."""
        least = np.zeros(self.numbers)
        least[0] = -np.inf if self.squares and self.lasting else 0.0
        least[4:] = -np.inf
        return least

    def begun(self, count: int) -> Floats:
        """The sums before the first range, (n, 3 or 5)."""
        sums = np.full((count, self.numbers), BEGIN)
        if self.ratios:
            sums[:, :2] *= _SMALL
        sums[:, 4:] = 0.0
        return sums

    def of(self, plain: Innovations, biased: Innovations, alike: Floats | None = None) -> Floats:
        """What ranges say: l_0, l_1 and 1 where there was one, otherwise zeros; or q_0, q_1, 1, C and s; (..., 3 or 5).

        alike: correlations of errors with those before them, below 1, (...); None: not known.
        """
        first, second = (np.nan_to_num(nis) for _, nis in (plain, biased))
        gained = np.zeros_like(first)
        if self.likelihoods:
            usable = (first > 0.0) & (second > 0.0)
            sizes = (np.where(usable, size, 1.0) ** 2 for size, _ in (plain, biased))
            variances = [
                square / np.where(usable, nis, 1.0) for square, nis in zip(sizes, (first, second), strict=True)
            ]
            gained = np.where(usable, np.log(variances[0]) - np.log(variances[1]), 0.0)
        there = np.isfinite(plain[1]).astype(np.float64)
        if self._free:
            counts = there if alike is None else there / self._followed(alike)
            squares = [counts * np.minimum(each, LARGEST) for each in (first, second)]
            return np.stack([*squares, there, counts, counts * gained], axis=-1)
        # On whichever side leaves both sums positive, as counts are.
        cut = (
            np.minimum(first, LARGEST) + np.maximum(gained, 0.0),
            np.minimum(second, LARGEST) - np.minimum(gained, 0.0),
        )
        if self.lasting and alike is not None:
            followed = self._followed(alike)
            if self.squares:
                cut = cut[1] + (cut[0] - cut[1]) / followed, cut[1]
            else:
                cut = cut[0] / followed, cut[1] / followed
        return np.stack([*cut, there], axis=-1)

    def _followed(self, alike: Floats) -> Floats:
        """What a range gains by following errors of which each has such a correlation with those before it."""
        return np.clip(-np.log(1.0 - alike**2), _FOLLOWED if self.presumes else _FOLLOWED_BEFORE, 1.0)

    def claimed(self, sums: Floats, agents: int) -> Floats:
        """Weight of the biased filter in what agents claim, (...); so many share the sums."""
        weight = self.weight(sums)
        if not (self._free and self.opens):
            return weight
        plain, biased, spreads = (sums[..., one] / sums[..., 2] for one in (0, 1, 4))
        against = step(biased - plain - spreads, *_GAIN)
        unknown = 1.0 - step(sums[..., 2] / min(agents, _SHARERS), *_UNKNOWN)
        return np.maximum(weight, _HALF * unknown * (1.0 - against))

    def weight(self, sums: Floats) -> Floats:
        """Weight of the biased filter by what ranges say, (...)."""
        plain, biased = sums[..., 0] / sums[..., 2], sums[..., 1] / sums[..., 2]
        if self._free:
            counts, spreads = sums[..., 3] / sums[..., 2], sums[..., 4] / sums[..., 2]
            gained = step(plain - biased + spreads + _PRESUMED * counts, *_GAIN)
            return np.maximum(gained, step(counts * np.log(plain / biased) + spreads, *_BEYOND))
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
