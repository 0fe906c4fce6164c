"""CBEF with unit rows, a bounded gain and a velocity channel: the smallest repair of the paper's filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.kinds.cbef import Cbef
from zenoh_cbef.tracking.linalg import neighbour_sum
from zenoh_cbef.tracking.ranging import Measurement, differenced_rows


@dataclass(frozen=True)
class ScaledCbef(Cbef):
    """CBEF (Ghods, Doostmohammadian, ICRoM 2024) made to contract at any scale, as an alpha-beta tracker.

        h_j  = (p_j - p_i)/|p_j - p_i|,   z_j = y_j/|p_j - p_i| - h_j^T p       rows of unit length, z in m
        g    = min(1, xi/|z|)                                                  saturation, |z| over all rows
        c    = g/|N_i| sum_j h_j z_j                                           |N_i|: rows there are this step
        p   <- p + alpha c,   v <- v + (beta/D) c,   then consensus on the state

    The eigenvalues of sum_j h_j h_j^T / |N_i| sum to one, so the update contracts wherever the agents are, which the
    paper's gain does not, and the velocity is corrected: an alpha-beta tracker is stable while 2 alpha + beta < 4.
    Dividing by a short baseline magnifies the noise of its row.

    It has no covariance. xi: saturation level, in m.
    """

    alpha: float = 0.5
    beta: float = 0.1

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The saturated measurement update; the payload is the updated state (n, s)."""
        updated = self.motion.predict_state(belief.state)
        axes = self.space.axes
        rows, right, present = differenced_rows(self.space, measurement)
        length = np.sqrt(np.sum(rows * rows, axis=2))
        # Agents at one place (in a plane, above each other) say nothing of where the target is.
        present &= length > 0.0
        length = np.where(present, length, 1.0)
        rows, right = rows / length[:, :, None], right / length
        innovation = np.where(present, right - np.sum(rows * updated[:, None, :axes], axis=2), 0.0)
        size = np.sqrt(neighbour_sum(innovation * innovation))
        gain = np.where(size <= self.xi, 1.0, self.xi / np.where(size > 0.0, size, 1.0))
        count = present.sum(axis=1)
        correction = (gain / np.maximum(count, 1))[:, None] * neighbour_sum(rows * innovation[:, :, None])
        updated[:, :axes] += self.alpha * correction
        updated[:, axes:] += self.beta / self.motion.dt * correction
        return Update(updated, Diagnostics.where(count > 0, innovation=size, weight=gain))
