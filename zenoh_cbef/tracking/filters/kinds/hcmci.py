"""Hybrid consensus on measurements and consensus on information."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.base import Abilities, Belief, Sharing, Update
from zenoh_cbef.tracking.filters.information_form import (
    belief_of,
    own_information,
    pack,
    packed_size,
    predict,
    unless_alone,
)
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import inverse, matvec
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Measurement, Space


@dataclass(frozen=True)
class HybridConsensus:
    """HCMCI of Battistelli, Chisci, Mugnai, Farina, Graziano (IEEE TAC 60(5), 2015), with the saturation of sicf.

    Priors and new information are averaged side by side, and only the new information is multiplied again:

        q_i = P_i^-1 x_i,  Omega_i = P_i^-1;     u_i, U_i: information_form.own_information
        after averaging q, Omega, u and U:
        O_i = Omega_i + omega U_i,  xhat_i = O_i^-1 (q_i + omega u_i),  P_i = O_i^-1

    omega = n counts every measurement once as rounds go to infinity, and is then the information-weighted filter
    (icf, sicf) computed from twice as many numbers. With fewer rounds its covariance is somewhat too small, as that
    filter's is; omega = 1 is `ci`, conservative. Where n is not known, choose an omega between 1 and n.

    range_std: sigma (m). omega: weight of the new information. xi: saturation level in standard
    deviations. power: of the saturation, see `sicf`.
    """

    motion: Motion
    space: Space
    range_std: float
    omega: float
    xi: float = np.inf
    power: int = 1

    abilities: ClassVar = Abilities(information=True, saturates=True, noise=True)

    @classmethod
    def sharing(cls, settings: FilterSettings) -> Sharing:
        """Prior and new information, each a vector and the upper triangle of a matrix."""
        return Sharing(2 * packed_size(settings.motion.size))

    @classmethod
    def of(cls, settings: FilterSettings) -> Self:
        """The filter of these settings."""
        omega = float(settings.network_size) if settings.omega is None else settings.omega
        return cls(settings.motion, settings.space, settings.range_std, omega, settings.xi, settings.power)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """Payload rows are [q, upper triangle of Omega, u, upper triangle of U]."""
        state, covariance = predict(self.motion, belief)
        prior = inverse(covariance)
        own = own_information(
            self.space, state, covariance, measurement, range_std=self.range_std, xi=self.xi, power=self.power
        )
        payload = np.concatenate([pack(matvec(prior, state), prior), pack(own.vector, own.matrix)], axis=1)
        return Update(payload, own.diagnostics, (state, covariance))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """State and covariance of averaged prior plus omega times averaged new information."""
        belief = belief_of(self._joined(payload), self._joined(update.payload), self.motion.size)
        return unless_alone(belief, payload, update)

    def _joined(self, payload: Floats) -> Floats:
        half = packed_size(self.motion.size)
        return payload[:, :half] + self.omega * payload[:, half:]
