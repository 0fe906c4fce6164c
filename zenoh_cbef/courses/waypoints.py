"""A target that follows points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.courses.base import Settled


@dataclass(frozen=True)
class Waypoints(Settled):
    """Along `waypoints` at constant `speed`; it rests at the last one."""

    def states(self, time: Floats) -> Floats:
        """Straight legs, (t, 6)."""
        return along(np.array(self.settings.waypoints), self.settings.speed, time)


def along(points: Floats, speed: float, time: Floats) -> Floats:
    """States (t, 6) of a body that follows points (w, 3) at constant speed (m/s) and rests at the last."""
    legs = np.diff(points, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    reached = np.concatenate([[0.0], np.cumsum(lengths)])
    distance = speed * time
    position = np.stack([np.interp(distance, reached, points[:, axis]) for axis in range(3)], axis=1)
    leg = np.clip(np.searchsorted(reached, distance, side="right") - 1, 0, max(len(legs) - 1, 0))
    direction = legs / np.where(lengths > 0.0, lengths, 1.0)[:, None] if len(legs) else np.zeros((1, 3))
    moving = (distance < reached[-1])[:, None]
    return np.concatenate([position, np.where(moving, speed * direction[leg], 0.0)], axis=1)
