"""A range noise that was given, doubted: a network compares what innovations say of half and of double of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.evidence import step
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Filter, Update
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.ranging import Measurement

_CUT = 9.0
"""Where a square is cut off, so that outliers do not decide: three standard deviations."""

_MEMORY, _BEGIN = 400.0, 50.0
"""How many of the network's ranges it remembers, and how many it begins with that say nothing."""

_GAIN = (0.1, 0.5)
"""Mean of twice the gained log likelihood of a range from which on another noise is believed, and at which fully.

Of Gaussian innovations, a noise that is twice or half of the true one loses 0.7.
"""

_CALM = 0.1
"""Distrust from which on an agent's ranges teach nothing of the noise."""

_LEAST = 0.1
"""Least share of an innovation's variance that following lasting errors leaves."""


@dataclass(frozen=True)
class DoubtedNoise(Wrapping):
    """Any filter of information on own ranges, whose given noise sigma may be wrong by a factor of two.

        l_f(q) = min(q/f^2, 9) + ln f^2,   q = m^2 z^2/S,   q' = m^2 z^2/(S - followed)
        g = mean[l_1(q') - l_1/2(q')],  h = mean[l_1(q) - l_2(q)]     over the network's last 400 ranges
        log2 m = step(h; 0.1, 0.5) - step(g; 0.1, 0.5),   sigma <- m sigma

    l_f is twice the negative log likelihood of an innovation z, if sigma is f times what was given. S is the filter's
    variance of z, which grows with the noise, so it is S/m^2 with the given one. An estimate that follows errors that
    last has smaller innovations than that, which is no reason to trust ranges more. What the network averages are two
    numbers, what the agent's range says of both, and a third, whether there is one; n times their average is the
    network's sum. A noise that is about right is left as it is, bit for bit.

    By rules before the thirteenth the means began as if 400 ranges had said nothing, so where ranges are rare a wrong
    noise was believed for minutes. Agents then told each other by how much their ranges are off both means.

    range_std: the given sigma, m. network_size: n. fix: steps of the first fix, in which nothing is learned. counts:
    whether the network counts its ranges, as by today's rules.
    """

    range_std: float
    network_size: int
    fix: int
    counts: bool = True

    @classmethod
    def of(cls, settings: FilterSettings, inner: Filter) -> Self:
        """Around a filter with these settings."""
        return cls(inner, settings.range_std, settings.network_size, settings.first_fix, settings.counts_ranges)

    @staticmethod
    def numbers(settings: FilterSettings) -> int:
        """How many numbers a payload has more with these settings."""
        return settings.doubts_noise * (2 + settings.counts_ranges)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update with the noise that the network has come to believe, and the two numbers."""
        inner = belief.parts[0] if belief.parts else belief
        count = len(belief.state)
        sums, seen = belief.memory or (self._begun(count), np.zeros(count))
        gained = sums[:, :2] / sums[:, 2:] if self.counts else sums
        scale = 2.0 ** (step(gained[:, 1], *_GAIN) - step(gained[:, 0], *_GAIN))
        update = self.filter.update(inner, replace(measurement, range_std=self.range_std * scale))
        told = update.diagnostics
        usable = (told.nis > 0.0) & ~(told.distrust > _CALM) & (seen >= self.fix)
        square = np.where(usable, told.nis, 1.0) * scale**2
        alone = square
        if measurement.followed is not None:
            variance = np.where(usable, told.innovation, 1.0) ** 2 * scale**2 / square
            alone = square * variance / np.maximum(variance - measurement.followed, _LEAST * variance)
        fresh = np.stack([_cost(alone, 1.0) - _cost(alone, 0.5), _cost(square, 1.0) - _cost(square, 2.0)], axis=1)
        said = np.concatenate([fresh, np.ones((count, 1))], axis=1) if self.counts else fresh - gained
        payload = np.concatenate([update.payload, np.where(usable[:, None], said, 0.0)], axis=1)
        return Update(payload, told, (sums, seen + 1.0), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, and what the network's ranges say of the noise."""
        own = update.parts[0].payload.shape[1]
        inner = self.filter.conclude(np.ascontiguousarray(payload[:, :own]), update.parts[0])
        sums, seen = update.kept
        said = np.fmin(np.fmax(payload[:, own:], -_CUT), _CUT)
        if self.counts:
            said = self.network_size * said
            ranges = np.fmin(np.fmax(said[:, 2:], 0.0), self.network_size)
            sums = np.exp(-ranges / _MEMORY) * sums + np.concatenate([said[:, :2], ranges], axis=1)
        else:
            sums = np.clip(sums + min(1.0, self.network_size / _MEMORY) * said, -_CUT, _CUT)
        return replace(inner, memory=(sums, seen), parts=(inner,), chance=None)

    def _begun(self, count: int) -> Floats:
        """What so many agents begin with: sums of what is gained and of ranges, or by earlier rules two means."""
        return np.tile([0.0, 0.0, _BEGIN], (count, 1)) if self.counts else np.zeros((count, 2))


def _cost(square: Floats, factor: float) -> Floats:
    return np.asarray(np.minimum(square / factor**2, _CUT) + 2.0 * np.log(factor))
