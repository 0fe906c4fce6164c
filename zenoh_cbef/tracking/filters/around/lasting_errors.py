"""Errors of ranges that last: agents learn from their residuals how alike successive ones are, and how large."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.around.distrusting import CALM
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Filter, Update
from zenoh_cbef.tracking.filters.information_form import variance_of
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import inverse, matvec
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Measurement, Space, own_range

_MEDIAN = 0.67448975
"""Median of |v| for v ~ N(0, 1)."""

_MEMORY, _BEGIN = 100.0, 20.0
"""How many pairs of its own ranges an agent remembers, and how many independent ones it begins with."""

_MOST = 0.98
"""The largest correlation of successive errors that counts: further ranges then still tell a hundredth."""

_CUT, _LEAST = 9.0, 0.1
"""Where a square is cut off, so that outliers do not decide, and the least share of its variance that following leaves.
"""

_SLOWEST = 0.02
"""Least step of the logarithm of sigma."""

_WIDEST = 30.0
"""By what factor sigma may leave where it began."""


@dataclass(frozen=True)
class Receiver:
    """What an agent knows of its receiver, arrays (n,).

    agreed, pairs: fading sums of the product of a residual's sign and the mean of those before it, and of their number.
    last: that mean, by rules before the thirteenth the last sign alone; past: the sum of its weights. sizes, counted:
    fading sums of the squares of innovations over what they should be, and of their number. left: the share of what the
    estimate knew at the last own range that it still rests on. scale: log sigma over where that began. seen: own ranges
    so far. large: what the last residual says of sigma. steps: since the start. taken: the variance of its error that
    the last own range brought into the estimate, m^2. excess: by what share the variance of the position is larger than
    the filter's.
    """

    agreed: Floats
    pairs: Floats
    sizes: Floats
    counted: Floats
    last: Floats
    past: Floats
    left: Floats
    scale: Floats
    seen: Floats
    large: Floats
    steps: Floats
    taken: Floats
    excess: Floats

    @classmethod
    def first(cls, count: int) -> Self:
        """Of so many agents before the first step."""
        none, one = np.zeros(count), np.ones(count)
        begun = {"pairs": _BEGIN * one, "sizes": _BEGIN * one, "counted": _BEGIN * one, "left": one}
        return cls(**{each.name: begun.get(each.name, none) for each in fields(cls)})

    @property
    def alike(self) -> Floats:
        """The correlation of an error with those before it, (n,), from 0 on."""
        return np.clip(np.sin(0.5 * np.pi * self.agreed / self.pairs), 0.0, _MOST)

    @property
    def surely(self) -> Floats:
        """No less than that correlation, (n,): as if the pairs that an agent begins with had been all alike."""
        begun = _BEGIN * (1.0 - 1.0 / _MEMORY) ** self.seen
        return np.clip(np.sin(0.5 * np.pi * np.minimum((self.agreed + begun) / self.pairs, 1.0)), 0.0, _MOST)

    @property
    def larger(self) -> Floats:
        """How many times as large as they should be the squares of innovations are, (n,), from 1 on."""
        return np.maximum(self.sizes / self.counted, 1.0)

    def carried(self, *, weighs: bool) -> Floats:
        """The correlation of an error with all that the estimate keeps of those before it, (n,).

        weighs: whether that is measured; otherwise as of errors of which each has to do with the one before alone.
        """
        left = np.minimum(self.left, _MOST)
        return self.alike / (1.0 - (left if weighs else self.alike * self.left))

    @property
    def followed(self) -> Floats:
        """By how much the variance of an innovation is smaller as the estimate follows errors, (n,), m^2.

        At least: of errors of which each has to do with the one before alone. More of it would hide that a noise is
        told twice as large.
        """
        return 2.0 * self.taken * self.carried(weighs=False)

    def factor(self, *, weighs: bool) -> Floats:
        """F, (n,)."""
        if weighs:
            return 1.0 + 2.0 * self.left * self.carried(weighs=True)
        correlation = self.alike * self.left
        return (1.0 + correlation) / (1.0 - correlation)

    def measuring(self, told: Diagnostics) -> Self:
        """With what an own range's innovation says of its size; a receiver that is distrusted says nothing."""
        usable = (told.nis > 0.0) & ~(told.distrust > CALM)
        square = np.where(usable, told.innovation, 1.0) ** 2
        variance = square / np.where(usable, told.nis, 1.0)
        followed = 2.0 * self.taken * self.carried(weighs=True)
        free = np.maximum(variance - followed, _LEAST * variance)
        kept = np.where(usable, 1.0 - 1.0 / _MEMORY, 1.0)
        return replace(
            self,
            sizes=kept * self.sizes + np.where(usable, np.minimum(square / free, _CUT), 0.0),
            counted=kept * self.counted + usable,
        )

    def after(
        self,
        residual: Floats,
        variance: Floats,
        network: Floats,
        forgotten: Floats,
        measured: Bools,
        *,
        weighs: bool = False,
    ) -> Self:
        """A step later.

        residual: of the own range, m, NaN where it teaches nothing, and the variance that it should have, m^2. network:
        the average of what all agents' last residuals said. forgotten: what share of the past this step has left.
        measured: whether there was an own range. weighs: whether all residuals that the estimate keeps count.
        """
        heard = np.isfinite(residual)
        sign = np.sign(np.where(heard, residual, 0.0))
        kept = np.where(heard, 1.0 - 1.0 / _MEMORY, 1.0)
        gain = np.maximum(1.0 / (1.0 + self.seen / 5.0), _SLOWEST)
        limit = np.log(_WIDEST)
        past = self.left * self.past * weighs
        return replace(
            self,
            agreed=kept * self.agreed + sign * self.last,
            pairs=kept * self.pairs + np.abs(sign) * ((self.past > 0.0) if weighs else np.abs(self.last)),
            last=np.where(heard, (sign + past * self.last) / (1.0 + past), self.last),
            past=np.where(heard, 1.0 + past, self.past),
            left=np.where(measured, 1.0, self.left) * forgotten,
            scale=np.clip(self.scale + gain * network, -limit, limit),
            seen=self.seen + heard,
            large=np.where(heard, np.where(residual**2 > _MEDIAN**2 * variance, 1.0, -1.0), 0.0),
            steps=self.steps + 1.0,
        )


@dataclass(frozen=True)
class LastingErrors(Wrapping):
    """Any filter of information on own ranges, of which successive ones may have alike errors.

    Reflections, and what they add to a range, change with the place, so real errors last for seconds. A filter that
    takes them for independent counts each of them again and again, and is too sure by far. An estimate that forgets a
    share 1 - k of its past from one own range to the next has, of errors with a correlation c from range to range, the
    variance that it would have of independent ones, times (a sum over exponential weights)

        F = (1 + c k)/(1 - c k),    k = product of H P+ H^T/(H P- H^T) over the steps since the last own range

    c follows from the signs of residuals e = r - h(x+) - bias, which outliers hardly disturb (Van Vleck's arcsine law,
    for Gaussian errors):

        c = sin(pi/2 mean[sign(e) sign(former e)]),    over the last 100 own ranges, at first 0

    With `claims` the filter's P stays as it is, and what agents claim is (1 + excess) P, where kappa is the share of
    the position's variance that ranges of this step bring into the estimate. The average of F is a number more in
    messages:

        excess <- (1 - kappa) excess + kappa (mean F - 1),    kappa = tr(P+ - P+ P-^-1 P+)/tr(P+)

    With `weighs`, by today's rules, c is the correlation of an error with all those before it that the estimate still
    rests on, as far as it does: errors that last for long decay more slowly than powers of the first correlation. And
    innovations z that are larger than they should be widen what is claimed, as they tell of a sigma that is too small
    also where the estimate follows errors:

        F = (1 + 2 k c/(1 - k)) max(1, mean[min(z^2/(S - 2 H P+ H^T c/(1 - k)), 9)]),
        c = sin(pi/2 mean[sign(e) m]),    m <- (sign(e) + k w m)/(1 + k w),  w <- 1 + k w

    By rules before the twelfth the information in a range is divided by F; its innovation is judged as before. A filter
    that trusts ranges less lags the more, and then has alike residuals.

    With `learns`, by these rules, the network also learns sigma, by stochastic approximation (Robbins and Monro, 1951)
    of the value at which half of the residuals are small. As P+ holds the range itself, a residual has the variance
    f sigma^2:

        f = 1 - H P+ H^T/(F sigma^2),   y_i = f sign(e^2 - 0.6745^2 f sigma^2), 0 without a range
        log sigma <- log sigma + max(1/(1 + m/5), 0.02) (average of y over the network)

    Innovations would not do: a filter that follows lasting errors has small ones, and the smaller sigma, the more it
    follows. Nor would agents that learn alone: one that is trusted has small residuals, and is trusted more. y of the
    step before is the number that a message has more. m: own ranges so far.

    range_std: sigma (m), or where learning it begins. fix: steps of the first fix, in which nothing is learned.
    """

    motion: Motion
    space: Space
    range_std: float
    learns: bool
    fix: int
    claims: bool = False
    weighs: bool = False

    @classmethod
    def of(cls, settings: FilterSettings, inner: Filter) -> Self:
        """Around a filter with these settings."""
        std, learns = settings.range_std, settings.learns_noise
        fix, claims, weighs = settings.first_fix, settings.recorded, settings.recorded and settings.counts_ranges
        return cls(inner, settings.motion, settings.space, std, learns=learns, fix=fix, claims=claims, weighs=weighs)

    @staticmethod
    def numbers(settings: FilterSettings) -> int:
        """How many numbers a payload has more with these settings."""
        return settings.lasting * (settings.learns_noise + settings.recorded)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update; kept: what the agent knew of its receiver, and what the residual needs."""
        inner = belief.parts[0] if belief.parts else belief
        known = Receiver(*belief.memory) if belief.memory else Receiver.first(len(belief.state))
        factor = known.factor(weighs=self.weighs)
        if self.learns:
            measurement = replace(measurement, range_std=self.range_std * np.exp(known.scale))
        told = [known.large] * self.learns + [factor * known.larger if self.weighs else factor] * self.claims
        if self.claims:
            factor = np.ones_like(factor)
        lasting = replace(measurement, lasting=factor, followed=known.followed, alike=known.surely)
        update = self.filter.update(inner, lasting)
        payload = np.concatenate([update.payload, *(one[:, None] for one in told)], axis=1) if told else update.payload
        state = self.motion.predict_state(inner.state)
        covariance = self.motion.predict_covariance(inner.known_covariance, inner.state)
        _, before = self._predicted(state, covariance, measurement.position, measurement.age)
        heard = measurement.position, measurement.range, measurement.age, variance_of(measurement, self.range_std)
        known = known.measuring(update.diagnostics)
        kept = *vars(known).values(), *heard, factor, before, covariance
        return Update(payload, update.diagnostics, kept, (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, and what the residual of the own range teaches."""
        *former, position, range_, age, variance, factor, before, prior = update.kept
        known, network = Receiver(*former), np.zeros(len(payload))
        own = update.parts[0].payload.shape[1]
        if self.learns:
            network = np.fmin(np.fmax(payload[:, own], -1.0), 1.0)
        inner = self.filter.conclude(np.ascontiguousarray(payload[:, :own]), update.parts[0])
        predicted, after = self._predicted(inner.state, inner.known_covariance, position, age)
        bias = 0.0 if inner.bias is None else inner.bias.weight * inner.bias.value
        residual = np.where(known.steps < self.fix, np.nan, range_ - predicted - bias)
        free = 1.0 - np.minimum(after / (factor * variance), 1.0)
        forgotten = np.clip(after / np.where(before > 0.0, before, 1.0), 0.0, 1.0)
        known = known.after(residual, free * variance, network, forgotten, np.isfinite(range_), weighs=self.weighs)
        known = replace(
            known, large=known.large * free, taken=np.where(np.isfinite(range_), after / factor, known.taken)
        )
        if self.claims:
            known = replace(known, excess=self._excess(known.excess, payload[:, -1], prior, inner))
            wide = inner.known_covariance * (1.0 + known.excess)[:, None, None]
            wider = replace(inner, covariance=wide, memory=tuple(vars(known).values()), parts=(inner,))
            return replace(wider, excess=known.excess) if self.weighs else wider
        return replace(inner, memory=tuple(vars(known).values()), parts=(inner,))

    def _excess(self, before: Floats, factor: Floats, prior: Floats, belief: Belief) -> Floats:
        """By what share the variance of the position is larger than the filter's, (n,).

        before: the same, a step ago. factor: the network's F. prior: covariances of this step, (n, s, s).
        """
        factor = np.fmin(np.fmax(factor, 1.0), (1.0 + _MOST) / (1.0 - _MOST))
        after = belief.known_covariance
        fresh = after - after @ inverse(prior) @ after  # What this step's ranges bring into the estimate.
        total = share = np.zeros(len(after))
        for axis in range(self.space.axes):
            total, share = total + after[:, axis, axis], share + fresh[:, axis, axis]
        share = np.clip(share / total, 0.0, 1.0)
        return (1.0 - share) * before + share * (factor - 1.0)

    def _predicted(self, state: Floats, covariance: Floats, position: Floats, age: Floats) -> tuple[Floats, Floats]:
        """The own range as an estimate has it, m, and its variance, m^2, (n,) each."""
        distance, row = own_range(self.space, state, position, age)
        return distance, np.asarray(np.add.reduce(row * matvec(covariance, row), axis=1))
