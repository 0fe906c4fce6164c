"""The information-weighted consensus filter on the agent's own range, with a saturated innovation."""

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
from zenoh_cbef.tracking.linalg import BY_LIBRARY, Inversion, matvec
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.outliers import Errors
from zenoh_cbef.tracking.ranging import Measurement, Space


@dataclass(frozen=True)
class SaturatedInformation:
    """The information-weighted consensus filter with a saturated innovation.

    ICF is of Kamal, Farrell, Roy-Chowdhury (IEEE TAC 58(12), 2013); the saturation is the CBEF paper's made
    statistical: in units of the innovation's own standard deviation.

        s_i = sqrt(H P_i H^T + sigma^2)
        z_i = r_i - h(x_i),                  w_i = min(1, xi s_i/|z_i|)^power
        V_i = P_i^-1 x_i / n + w_i H^T (z_i + H x_i)/sigma^2
        O_i = P_i^-1 / n     + w_i H^T H / sigma^2
        (more in place of sigma^2/w_i, as far as it widens: see `saturated_precision`)
        after averaging V and O:  xhat_i = O_i^-1 V_i,  P_i = (n O_i)^-1

    An agent linearises its own range, so no measurement is counted twice and none has to be exchanged. With few
    rounds the covariance is somewhat too small, as it is of an average that was not quite reached.

    range_std: sigma (m). network_size: n. xi: saturation level in standard
    deviations, infinite for the plain ICF. power: 1 bounds the pull of an outlier, 2 lets it fall (redescending).
    widens: how far a range far off widens its whole innovation, not its noise alone. outliers: of which the scenario
    tells; their distribution then decides in place of the saturation. inversion: of P_i and O_i.
    """

    motion: Motion
    space: Space
    range_std: float
    network_size: int
    xi: float = np.inf
    power: int = 1
    widens: float = 0.0
    outliers: Errors | None = None
    inversion: Inversion = BY_LIBRARY

    abilities: ClassVar = Abilities(
        information=True, saturates=True, biases=True, noise=True, models=True, outliers=True
    )

    @classmethod
    def sharing(cls, settings: FilterSettings) -> Sharing:
        """Information vector and the upper triangle of the information matrix; an agent alone exchanges nothing."""
        size = settings.motion.size
        return Sharing(packed_size(size), cooperates=settings.network_size > 1, blocks=(size,))

    @classmethod
    def of(cls, settings: FilterSettings) -> Self:
        """The filter of these settings."""
        return cls(
            motion=settings.motion,
            space=settings.space,
            range_std=settings.range_std,
            network_size=settings.network_size,
            xi=settings.xi,
            power=settings.power,
            widens=settings.widens,
            outliers=settings.weighed,
            inversion=settings.inversion,
        )

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The agent's share of the network's information; payload rows are [V, upper triangle of O]."""
        state, covariance = predict(self.motion, belief)
        prior = self.inversion.inverse(covariance) / self.network_size
        own = own_information(
            *(self.space, state, covariance, measurement),
            range_std=self.range_std,
            xi=self.xi,
            power=self.power,
            widens=self.widens,
            outliers=self.outliers,
        )
        payload = pack(matvec(prior, state) + own.vector, prior + own.matrix)
        return Update(payload, own.diagnostics, (state, covariance))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """State and covariance from the averaged information, of which the network has n times as much."""
        belief = belief_of(payload, update.payload, self.motion.size, self.network_size, self.inversion)
        return unless_alone(belief, payload, update) if self.network_size > 1 else belief
