"""The consensus-based estimation filter, to the letter of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.base import Abilities, Belief, Update
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.filters.state_form import StateExchange
from zenoh_cbef.tracking.linalg import neighbour_sum
from zenoh_cbef.tracking.ranging import Measurement, differenced_rows


@dataclass(frozen=True)
class Cbef(StateExchange):
    """CBEF of Ghods and Doostmohammadian (ICRoM 2024): saturated innovation, then consensus on the state.

        z_i    = y_i - H_i A xhat_i(k-1)
        g_i    = 1 if |z_i| <= xi else xi/|z_i|
        xhat_i = A xhat_i(k-1) + g_i H_i^T z_i

    The gain is H^T itself: the update contracts only while the eigenvalues of H_i^T H_i stay below 2, and as H_i
    has no velocity columns the velocity is never corrected. docs/method.md shows both.

    xi: saturation level, in the innovation's unit (m^2).
    """

    xi: float

    abilities: ClassVar = Abilities(differences=True, covariance=False)

    @classmethod
    def of(cls, settings: FilterSettings) -> Self:
        """The filter of these settings."""
        return cls(settings.motion, settings.space, settings.xi)

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
        measured = np.asarray(present.any(axis=1))
        return Update(updated, Diagnostics.where(measured, innovation=size, weight=gain))

    def conclude(self, payload: Floats, update: Update) -> Belief:  # noqa: ARG002 - as Filter has it
        """The state that consensus left; there is no covariance."""
        return Belief(payload, None)
