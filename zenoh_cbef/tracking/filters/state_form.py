"""What the filters that exchange states share."""

from __future__ import annotations

from dataclasses import dataclass

from zenoh_cbef.tracking.filters.base import Sharing
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Space


@dataclass(frozen=True)
class StateExchange:
    """A filter whose payload is a state (n, s), and that takes in its neighbours' positions and ranges."""

    motion: Motion
    space: Space

    @classmethod
    def sharing(cls, settings: FilterSettings) -> Sharing:
        """A state, after positions and ranges."""
        return Sharing(settings.motion.size, uses_neighbour_ranges=True)
