"""What the filters that exchange states share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.base import Abilities, Belief, Sharing
from zenoh_cbef.tracking.filters.information_form import RangeInformation, neighbourhood_information, predict
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import inverse
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Measurement, Space


@dataclass(frozen=True)
class StateExchange:
    """A filter whose payload is a state (n, s), and that takes in its neighbours' positions and ranges."""

    motion: Motion
    space: Space

    @classmethod
    def sharing(cls, settings: FilterSettings) -> Sharing:
        """A state, after positions and ranges."""
        return Sharing(settings.motion.size, uses_neighbour_ranges=True)


@dataclass(frozen=True)
class LinearisedRanges(StateExchange):
    """A filter that linearises all ranges of its neighbourhood at its own prior. range_std: sigma, m."""

    range_std: float

    abilities: ClassVar = Abilities()

    @classmethod
    def of(cls, settings: FilterSettings) -> Self:
        """The filter of these settings."""
        return cls(settings.motion, settings.space, settings.range_std)

    def informed(self, belief: Belief, measurement: Measurement) -> tuple[Floats, Floats, Floats, RangeInformation]:
        """Prior state (n, s) and covariance (n, s, s), the covariance after the update, and what was measured."""
        state, covariance = predict(self.motion, belief)
        heard = neighbourhood_information(self.space, state, covariance, measurement, range_std=self.range_std)
        return state, covariance, inverse(inverse(covariance) + heard.matrix), heard
