"""An agent whose range does not fit what the network makes of all ranges counts its next one for less."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.information_form import variance_of
from zenoh_cbef.tracking.linalg import matvec
from zenoh_cbef.tracking.ranging import Measurement, Space, own_range

_FITS = 2.0
"""Within how many standard deviations a range fits, as where the saturation redescends."""

_DENIES = 3.0
"""Within how many an estimate may be right."""

_MOST = 0.99
"""The most that a range of an agent passes for having added to what the network knows of it."""


@dataclass(frozen=True)
class Fitting(Wrapping):
    """Any filter of the agent's own range at a prior so wide that the range alone never shows that it is wrong.

        z = e/(1 - g),   s^2 = sigma^2 + h/(1 - g),   h = H P H^T,  g = h/sigma_i^2      after the ranges of a step
        sigma_i <- max(1, |z|/(2 s)) sigma                                               in the next one

    Where a target may be anywhere a step later, any range fits the prediction, and the saturation of the filter lets
    through one that is wrong by metres. All ranges together do not: that of one agent is compared with what those of
    all others make of it, which is what the network has found without the agent's own part g. What misled the network
    in a step counts less in the next one, so a receiver that stays wrong costs one step. Of ranges that are good
    nothing is lost, however the target turns.

    range_std: sigma (m), where a measurement does not say otherwise.
    """

    space: Space
    range_std: float

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update."""
        inner = belief.parts[0] if belief.parts else belief
        (factor,) = belief.memory or (np.ones(len(belief.state)),)
        variance = variance_of(measurement, self.range_std) * np.ones(len(belief.state))
        update = self.filter.update(inner, replace(measurement, range_std=factor * np.sqrt(variance)))
        kept = factor, variance, measurement.range, measurement.position, measurement.age
        return Update(update.payload, update.diagnostics, kept, (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, and by what the noise of the next range is multiplied."""
        inner = self.filter.conclude(payload, update.parts[0])
        factor, variance, ranges, position, age = update.kept
        predicted, row = own_range(self.space, inner.state, position, age)
        known = np.maximum(np.add.reduce(row * matvec(inner.known_covariance, row), axis=1), 0.0)
        heard, used = np.isfinite(ranges), factor**2 * variance
        others = 1.0 - np.minimum(known / used, _MOST)
        off = np.where(heard, (ranges - predicted) / others, 0.0) ** 2
        excess = np.maximum(off / (used + known / others) / _DENIES**2 - 1.0, 0.0)
        later = np.maximum(1.0, np.sqrt(off / (variance + known / others)) / _FITS)
        covariance = inner.known_covariance * (1.0 + excess)[:, None, None]
        memory = (np.where(heard, later, factor),)
        return replace(inner, covariance=covariance, memory=memory, parts=(inner,), chance=None, excess=excess)
