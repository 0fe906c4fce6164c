"""Consensus on information: covariance intersection of the agents' posteriors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.base import Abilities, Belief, Sharing, Update
from zenoh_cbef.tracking.filters.information_form import (
    belief_of,
    differenced_information,
    own_information,
    pack,
    packed_size,
    predict,
)
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import inverse, matvec
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Measurement, Space


@dataclass(frozen=True)
class CovarianceIntersection:
    """Consensus on information of Battistelli and Chisci (Automatica 50(3), 2014), with the saturation of sicf.

        V_i = P_i^-1 x_i + u_i,   O_i = P_i^-1 + U_i          u, U: information_form.own_information
        after averaging V and O:  xhat_i = O_i^-1 V_i,  P_i = O_i^-1

    An average with weights that sum to one is a covariance intersection: information that the agents' estimates have
    in common counts once at most. So the covariance is conservative (NEES below the dimension, by design), with
    any number of rounds, under any loss, and no agent needs to know the size of the network. Accelerated averaging
    has negative weights and loses that guarantee.

    For the same reason this filter may take in the paper's differenced rows, whose noise the agents share.

    range_std: sigma (m). xi: saturation level in standard deviations, infinite to turn it off. power: of the
    saturation, see `sicf`. differenced: whether u and U are of the differenced rows.
    """

    motion: Motion
    space: Space
    range_std: float
    xi: float = np.inf
    differenced: bool = False
    power: int = 1

    abilities: ClassVar = Abilities(information=True, saturates=True, differences=True, noise=True)

    @classmethod
    def sharing(cls, settings: FilterSettings) -> Sharing:
        """Information vector and the upper triangle of the information matrix; only differences need more."""
        size = settings.motion.size
        return Sharing(packed_size(size), uses_neighbour_ranges=settings.differenced, blocks=(size,))

    @classmethod
    def of(cls, settings: FilterSettings) -> Self:
        """The filter of these settings."""
        return cls(
            settings.motion,
            settings.space,
            settings.range_std,
            settings.xi,
            differenced=settings.differenced,
            power=settings.power,
        )

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The agent's own posterior; payload rows are [V, upper triangle of O]."""
        state, covariance = predict(self.motion, belief)
        prior = inverse(covariance)
        measure = differenced_information if self.differenced else own_information
        own = measure(
            self.space, state, covariance, measurement, range_std=self.range_std, xi=self.xi, power=self.power
        )
        payload = pack(matvec(prior, state) + own.vector, prior + own.matrix)
        return Update(payload, own.diagnostics)

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """State and covariance of the averaged information, which is not multiplied by anything."""
        return belief_of(payload, update.payload, self.motion.size)
