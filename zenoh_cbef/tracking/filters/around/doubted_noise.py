"""A range noise that was given, doubted: a network compares what innovations say of half and of double of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.evidence import step
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.ranging import Measurement

_CUT = 9.0
"""Where a square is cut off, so that outliers do not decide: three standard deviations."""

_MEMORY = 400.0
"""How many of the network's ranges it remembers."""

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
    numbers, by how much the agent's range is off both means. A noise that is about right is left as it is, bit for bit.

    range_std: the given sigma, m. network_size: n. fix: steps of the first fix, in which nothing is learned.
    """

    range_std: float
    network_size: int
    fix: int

    more = 2

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update with the noise that the network has come to believe, and the two numbers."""
        inner = belief.parts[0] if belief.parts else belief
        count = len(belief.state)
        gained, seen = belief.memory or (np.zeros((count, 2)), np.zeros(count))
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
        payload = np.concatenate([update.payload, np.where(usable[:, None], fresh - gained, 0.0)], axis=1)
        return Update(payload, told, (gained, seen + 1.0), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, and what the network's ranges say of the noise."""
        inner = self.filter.conclude(np.ascontiguousarray(payload[:, : -self.more]), update.parts[0])
        gained, seen = update.kept
        off = np.fmin(np.fmax(payload[:, -self.more :], -_CUT), _CUT)
        gained = np.clip(gained + min(1.0, self.network_size / _MEMORY) * off, -_CUT, _CUT)
        return replace(inner, memory=(gained, seen), parts=(inner,), chance=None)


def _cost(square: Floats, factor: float) -> Floats:
    return np.asarray(np.minimum(square / factor**2, _CUT) + 2.0 * np.log(factor))
