"""What the filters that exchange states share."""

from __future__ import annotations

from dataclasses import dataclass

from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Space


@dataclass(frozen=True)
class StateExchange:
    """A filter whose payload is a state (n, s), and that takes in its neighbours' positions and ranges."""

    motion: NearlyConstantVelocity
    space: Space

    uses_neighbour_ranges = True
    cooperates = True

    @property
    def payload_size(self) -> int:
        """A state."""
        return self.motion.size
