"""The consensus-based estimation filter, to the letter of the paper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.tracking.filters.base import Belief, Floats, Update
from zenoh_cbef.tracking.linalg import neighbour_sum
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, differenced_rows


@dataclass(frozen=True)
class Cbef:
    """CBEF of Ghods and Doostmohammadian (ICRoM 2024): saturated innovation, then consensus on the state.

        z_i    = y_i - H_i A xhat_i(k-1)
        g_i    = 1 if |z_i| <= xi else xi/|z_i|
        xhat_i = A xhat_i(k-1) + g_i H_i^T z_i

    The gain is H^T itself: the update contracts only while the eigenvalues of H_i^T H_i stay below 2, and as H_i
    has no velocity columns the velocity is never corrected. docs/method.md shows both.

    xi: saturation level, in the innovation's unit (m^2).
    """

    motion: NearlyConstantVelocity
    space: Space
    xi: float

    uses_neighbour_ranges = True
    cooperates = True

    @property
    def payload_size(self) -> int:
        """The state itself is exchanged."""
        return self.motion.size

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The saturated measurement update; the payload is the updated state (n, s)."""
        predicted = self.motion.predict_state(belief.state)
        axes = self.space.axes
        rows, right, present = differenced_rows(self.space, measurement)
        innovation = np.where(present, right - np.sum(rows * predicted[:, None, :axes], axis=2), 0.0)
        size = np.sqrt(neighbour_sum(innovation * innovation))
        gain = np.where(size <= self.xi, 1.0, self.xi / np.where(size > 0.0, size, 1.0))
        updated = predicted.copy()
        updated[:, :axes] += gain[:, None] * neighbour_sum(rows * innovation[:, :, None])
        measured = present.any(axis=1)
        return Update(updated, np.where(measured, size, np.nan), np.where(measured, gain, np.nan))

    def conclude(self, payload: Floats, update: Update) -> Belief:  # noqa: ARG002 - as Filter has it
        """The state that consensus left; the paper's filter has no covariance."""
        return Belief(payload, None)
