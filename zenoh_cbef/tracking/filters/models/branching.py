"""All ranges of a step together, of which some may be wrong: each branches into two, the likeliest branches stay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.models.abreast import Arrays, abreast
from zenoh_cbef.tracking.filters.models.expecting import Bias, Expected, likelihoods
from zenoh_cbef.tracking.filters.models.mixtures import NEVER, Priors, distinct, mixture, total
from zenoh_cbef.tracking.filters.models.persisting import again, judged
from zenoh_cbef.tracking.filters.rows import Rows
from zenoh_cbef.tracking.linalg import matvec, outer
from zenoh_cbef.tracking.motion import Motion, turned

MOST = 16
"""How many branches stay after each range."""

KEPT = 4
"""How many distinct ones stay from step to step."""

_STRAIGHT = 0.04
"""Up to which variance of a distance, in units of its square, the distance and not its square is linearised."""

_NEAREST = 0.1
"""The least distance at which a range is linearised, in units of its noise."""


@dataclass(frozen=True)
class Heard:
    """Ranges of m agents, as n agents know them.

    place: (n, m, axes), m, from where positions are counted. height: (n, m), m^2, the squared height above a known
    plane. range: (n, m), m, NaN where there is none. age: (n, m), s. variance: (n, m), of the noise, m^2.
    """

    place: Floats
    height: Floats
    range: Floats
    age: Floats
    variance: Floats


@dataclass(frozen=True)
class Branches:
    """Hypotheses on which ranges are wrong: k of n agents.

    mean: (n, k, d). covariance: (n, k, d, d). likelihood: (n, k), its logarithm. wrong: (n, k), how many ranges of the
    step are. biases: where those of a state begin. share: (n, 1), p where the scenario tells of no outliers; None: by
    the first rules. slack: (n, k), m^4, the variance that e has about its regression on x; None: e stays tied to x by
    that alone. motion: by which ranges may turn the velocity (see `turned`); None: they move it. exact: whether a
    wrong range's error counts from the distance, or in the square, by earlier rules: about a length that this range
    moves by metres, the more the less is known of the place, so that outliers spoke for agile motions. adds: whether a
    bias counts as what it adds to the distance (see `expected`), or in the square, by earlier rules. former:
    (n, k, m, 3), what is made of the ranges before (see persisting.py); None: it does not count.
    Squared ranges are linear in y = (x, e), e = |u|^2 with the position u: see `SquaredInformation`, which has the same
    equations. x: position, velocity, what else moves it, and perhaps the agents' biases from component `biases` on.

        r_i^2 = e - 2 b^T u + |b|^2 + (terms in the age) + 2 l (d_i + v) + (d_i + v)^2

    Each range i either has noise v ~ N(0, sigma^2) and updates y as in a Kalman filter, or is wrong and says nothing:

        right:  (1 - p) N(z; 0, S)              z: innovation, S: its variance
        wrong:  p exp(-z/m)/m  for z > 0        where the scenario tells of outliers: share p, mean m
                p exp(-|z|/m)/(2 m)             otherwise, m = 50 sigma; by the first rules, p = .02
                p/(2 m (1 + |z|/m)^2)           otherwise, by today's

    So what is decided of a range rests on all ranges before it in the step, and what was decided of those is taken back
    where later ones deny it: of 2 k branches the k likeliest stay. After the last one the estimate is the mixture's
    moments, and what the next steps have to decide about stays (`distinct`).
    """

    mean: Floats
    covariance: Floats
    likelihood: Floats
    wrong: Floats
    axes: int
    biases: int | None = None
    share: Floats | None = None
    slack: Floats | None = None
    motion: Motion | None = None
    exact: bool = False
    adds: bool = False
    former: Floats | None = None

    @classmethod
    def of(
        cls,
        priors: Priors,
        axes: int,
        biases: int | None = None,
        share: Floats | None = None,
        motion: Motion | None = None,
        *,
        ties: bool = False,
        exact: bool = False,
        adds: bool = False,
    ) -> Branches:
        """Of each prior one; e as the statistical linear regression on it tells. ties: see tying.py."""
        state, covariance, likelihood = priors
        size, place = state.shape[2], state[:, :, :axes]
        known = np.ascontiguousarray(covariance[:, :, :axes, :axes])
        flat = known.reshape(*known.shape[:2], -1)
        mean, whole = np.zeros((*state.shape[:2], size + 1)), np.zeros((*state.shape[:2], size + 1, size + 1))
        mean[:, :, :size], whole[:, :, :size, :size] = state, covariance
        mean[:, :, size] = np.add.reduce(place * place, axis=2)
        for axis in range(axes):
            mean[:, :, size] += known[:, :, axis, axis]
        slope = np.zeros_like(state)
        slope[:, :, :axes] = 2.0 * place
        cross = matvec(covariance, slope)
        whole[:, :, :size, size] = whole[:, :, size, :size] = cross
        slack = 2.0 * np.add.reduce(flat * flat, axis=2)
        whole[:, :, size, size] = np.add.reduce(slope * cross, axis=2) + slack
        none, adds = np.zeros_like(likelihood), adds and biases is not None
        return cls(mean, whole, likelihood, none, axes, biases, share, slack if ties else None, motion, exact, adds)

    def expected(self, heard: Heard, agent: int, which: Rows | None = None) -> Expected:
        """Of one agent's range: column `agent` of what was heard, whose bias is that of agent `which`.

        The square of l + d bends over d as well, and that by as much as the prior leaves open of d, the same way in
        each step, so that what many steps tell of l - d is soon taken for more than it says. A range itself does not:

            r_i - d_i = l + v,   E l = L - var(l)/2L,   L^2 = E l^2

        where l is known to a fifth of L, so that l is straight in l^2; elsewhere the square of r_i - d_i is, with
        cov(l, d) in its mean. l^2 stays the linear one of y = (x, e) either way.
        """
        axes, mean = self.axes, self.mean
        place, age = heard.place[:, None, agent], heard.age[:, agent, None, None]
        here, velocity = mean[:, :, :axes], mean[:, :, axes : 2 * axes]
        row = np.zeros_like(mean)
        row[:, :, :axes] = -2.0 * (place + age * velocity)
        row[:, :, axes : 2 * axes] = -2.0 * age * (here - age * velocity - place)
        row[:, :, -1] = 1.0
        late = 2.0 * age * here * velocity - (age * velocity) ** 2 + place * place
        square = np.add.reduce(row * mean, axis=2) + np.add.reduce(late, axis=2) + heard.height[:, agent, None]
        noise = heard.variance[:, agent, None]
        least = _NEAREST**2 * noise
        square = np.maximum(square, least)
        cross = matvec(self.covariance, row)
        spread = np.maximum(np.add.reduce(row * cross, axis=2), 0.0)
        distance, variance = np.sqrt(square), spread / (4.0 * square)
        ranges = np.where(np.isfinite(heard.range[:, agent]), heard.range[:, agent], 0.0)[:, None]
        bias = self._bias(row, distance, agent, which)
        around = variance + noise + bias.shared + bias.variance
        gain, straight = variance / (variance + noise), variance < _STRAIGHT * square
        if self.adds:
            gain = np.where(straight, 0.0, np.clip((variance + 0.5 * bias.shared) / around, 0.0, 1.0))
        less, mean, left = ranges - bias.mean, bias.mean, (1.0 - 4.0 * gain) * noise
        length = np.maximum(distance + gain * (less - distance), np.sqrt(least))
        if bias.column is not None:
            rows, column = bias.column
            row[rows, :, column] = 2.0 * length
            cross = matvec(self.covariance, row)
            spread = np.maximum(np.add.reduce(row * cross, axis=2), 0.0)
        if self.adds:
            apart = less * less - square - bias.variance - bias.shared - left
            excess = np.where(straight, 2.0 * distance * (less - distance) + variance, apart)
        else:
            excess = ranges * ranges - (square + 2.0 * length * mean + mean * mean + bias.variance) - left
        total, unit, known = spread + (4.0 * length * length + 2.0 * noise) * noise, 2.0 * length, distance + mean
        if not self.exact:
            return Expected(row, cross, known, variance, excess, total, unit, excess / unit, total / unit**2)
        return Expected(row, cross, known, variance, excess, total, unit, ranges - known, around)

    def _bias(self, row: Floats, distance: Floats, agent: int, which: Rows | None) -> Bias:
        """What is known of the bias of a range whose square has this derivative, (n, k, d)."""
        if self.biases is None:
            none = np.zeros_like(distance)
            return Bias(none, none, none)
        rows, column = np.arange(len(row)), self.biases + (np.full(len(row), agent) if which is None else which)
        shared = np.add.reduce(row * self.covariance[rows, :, column], axis=2) / distance
        return Bias(self.mean[rows, :, column], self.covariance[rows, :, column, column], shared, (rows, column))

    def after(self, heard: Heard, agent: int, outliers: tuple[float, float] | None, many: int = MOST) -> Branches:
        """With the range of an agent, right or wrong; so many stay."""
        there = np.isfinite(heard.range[:, agent])[:, None]
        told = self.expected(heard, agent)
        right, wrong = likelihoods(told, heard.variance[:, agent, None], outliers, self.share)
        if self.former is not None:
            right, wrong = again((right, wrong), (told.beyond, told.around), self.former[:, :, agent])
        likelihood = np.concatenate(
            [self.likelihood + np.where(there, right, 0.0), self.likelihood + np.where(there, wrong, NEVER)], axis=1
        )
        # Which branches stay is known before they are computed.
        kept = np.argsort(-likelihood, axis=1, kind="stable")[:, :many]
        rows, count = np.arange(len(kept))[:, None], self.likelihood.shape[1]
        which, is_wrong = (rows, kept % count), (kept >= count) & there
        before, cross = (self.mean[which], self.covariance[which]), told.cross[which]
        gain = np.where(there & ~is_wrong, 1.0 / told.total[which], 0.0)[:, :, None] * cross
        after = before[0] + gain * told.excess[which][:, :, None], before[1] - outer(gain, cross)
        if self.motion is not None:
            after = turned(self.motion, before, after)
        return replace(
            self,
            mean=after[0],
            covariance=after[1],
            likelihood=likelihood[rows, kept],
            wrong=self.wrong[which] + is_wrong,
            slack=None if self.slack is None else self.slack[which],
            former=None if self.former is None else self.former[which],
        )

    def with_former(self, former: Floats) -> Branches:
        """With what is made of the ranges before, (n, k', m, 3), before branches were split; zeros: nothing."""
        if not former.any():
            return self
        return replace(self, former=np.tile(former, (1, self.mean.shape[1] // former.shape[1], 1, 1)))

    def judged(self, heard: Heard) -> Floats:
        """What the branches make of ranges that they have taken in, (n, k, m, 3): see persisting.py."""
        likely, errors = [], []
        for agent in range(heard.range.shape[1]):
            told = self.expected(heard, agent)
            likely.append(np.stack(likelihoods(told, heard.variance[:, agent, None], None)))
            errors.append(np.stack([told.beyond, told.around]))
        return judged(np.stack(likely, axis=3), np.stack(errors, axis=3), np.isfinite(heard.range)[:, None], self.axes)

    def beside(self, other: Branches) -> Branches:
        """These and others."""
        return replace(
            self,
            mean=np.concatenate([self.mean, other.mean], axis=1),
            covariance=np.concatenate([self.covariance, other.covariance], axis=1),
            likelihood=np.concatenate([self.likelihood, other.likelihood], axis=1),
            wrong=np.concatenate([self.wrong, other.wrong], axis=1),
            slack=_beside(self.slack, other.slack),
            former=_beside(self.former, other.former),
        )

    def unless(self, rows: Bools) -> Branches:
        """The same, but of some agents (n,) none of them is right."""
        return replace(self, likelihood=np.where(rows[:, None], NEVER, self.likelihood))

    @property
    def wrong_ranges(self) -> Floats:
        """How many ranges of the step are wrong, (n,), on average over all branches."""
        weight = np.exp(self.likelihood - np.maximum.reduce(self.likelihood, axis=1)[:, None])
        return total(weight * self.wrong) / total(weight)

    @property
    def priors(self) -> Priors:
        """The branches without e."""
        size = self.mean.shape[2] - 1
        return self.mean[:, :, :size], self.covariance[:, :, :size, :size], self.likelihood

    def distinct(self, most: Floats | None = None, count: int = KEPT, near: float | None = None) -> Priors:
        """Those that later steps have to decide about: branches near a likelier one are merged with it.

        most: (n, 1), from which likelihoods are counted; None: from the likeliest. count, near: see mixtures.py.
        """
        states, covariances, likelihoods_ = distinct(self.priors, count, near)
        if most is None:
            most = np.maximum.reduce(likelihoods_, axis=1)[:, None]
        return states, covariances, np.maximum(likelihoods_ - most, NEVER)

    def merged(self) -> tuple[Floats, Floats, Floats]:
        """State (n, s) and covariance (n, s, s) of all branches, and the logarithm of their likelihood, (n,)."""
        return mixture(*self.priors)


def conditioned(prior: Branches, heard: Heard, outliers: tuple[float, float] | None, many: int = MOST) -> Branches:
    """The branches after all ranges, of which so many stay after each."""
    for agent in range(heard.range.shape[1]):
        prior = prior.after(heard, agent, outliers, many)
    return prior


def judged_by(
    motions: Sequence[Motion], wholes: Sequence[Priors], heard: Heard, axes: int, biases: int | None, *, adds: bool
) -> list[Floats]:
    """What each motion's hypotheses make of ranges that they have taken in, (n, k, m, 3) each: see persisting.py.

    axes, biases, adds: see `Branches`.
    """

    def of(_: Motion, rows: Arrays) -> Arrays:
        state, covariance, likelihood, *told = rows
        return (Branches.of((state, covariance, likelihood), axes, biases, exact=True, adds=adds).judged(Heard(*told)),)

    each = [(*whole, *vars(heard).values()) for whole in wholes]
    return [found for (found,) in abreast(motions, each, of)]


def _beside(one: Floats | None, other: Floats | None) -> Floats | None:
    return None if one is None or other is None else np.concatenate([one, other], axis=1)
