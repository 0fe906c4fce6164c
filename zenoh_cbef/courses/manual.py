"""A target that is steered by hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.courses.base import Settled


@dataclass(frozen=True)
class Manual(Settled):
    """From `position` straight to where its `orders` say, at its `speed`; it rests there.

    Of several orders that are on the last one holds. What an order changes comes after it, so one more changes no past.
    """

    def states(self, time: Floats) -> Floats:
        """Stretches of one order each, (t, 6)."""
        target, dt = self.settings, self.settings.dt
        chosen = np.full(len(time), -1)
        for number, order in enumerate(target.orders):
            chosen[(time >= order.since) & (time < order.until)] = number
        state = np.zeros((len(time), 6))
        state[0, :3] = target.position
        begins = [1, *(np.flatnonzero(np.diff(chosen[1:])) + 2).tolist()]
        for first, last in zip(begins, [*begins[1:], len(time)], strict=True):
            if first >= last:
                continue
            start = state[first - 1, :3]
            gap = (np.array(target.orders[chosen[first]].to) if chosen[first] >= 0 else start) - start
            away = max(float(np.linalg.norm(gap)), 1e-12)
            share = np.minimum(np.arange(1, last - first + 1) * (target.speed * dt / away), 1.0)
            state[first:last, :3] = start + share[:, None] * gap
        state[1:, 3:] = np.diff(state[:, :3], axis=0) / dt
        return state
