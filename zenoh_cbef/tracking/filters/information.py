"""Information-weighted consensus filters on the agent's own range: icf, sicf and local."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.tracking.filters.base import Belief, Floats, Update
from zenoh_cbef.tracking.linalg import inverse, matvec, outer, pack_upper, unpack_upper
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, own_range

_LEAST = 1e-12
"""Least over largest eigenvalue of what passes for an information matrix."""


@dataclass(frozen=True)
class SaturatedInformation:
    """The information-weighted consensus filter with a saturated innovation.

    ICF is of Kamal, Farrell, Roy-Chowdhury (IEEE TAC 58(12), 2013); the saturation is the CBEF paper's made
    statistical: in units of the innovation's own standard deviation.

        s_i = sqrt(H P_i H^T + sigma^2)
        z_i = r_i - h(x_i),                  w_i = min(1, xi s_i/|z_i|)
        V_i = P_i^-1 x_i / n + w_i H^T (z_i + H x_i)/sigma^2
        O_i = P_i^-1 / n     + w_i H^T H / sigma^2
        after averaging V and O:  xhat_i = O_i^-1 V_i,  P_i = (n O_i)^-1

    An agent linearises its own range, so no measurement is counted twice and none has to be exchanged.

    range_std: sigma (m). network_size: n; 1 makes the filter keep to itself. xi: saturation level in standard
    deviations, infinite for the plain ICF.
    """

    motion: NearlyConstantVelocity
    space: Space
    range_std: float
    network_size: int
    xi: float = np.inf

    uses_neighbour_ranges = False

    @property
    def cooperates(self) -> bool:
        """An agent alone has nobody to average with."""
        return self.network_size > 1

    @property
    def payload_size(self) -> int:
        """Information vector and the upper triangle of the information matrix."""
        size = self.motion.size
        return size + size * (size + 1) // 2

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The agent's share of the network's information; payload rows are [V, upper triangle of O]."""
        state = self.motion.predict_state(belief.state)
        covariance = self.motion.predict_covariance(belief.known_covariance)
        prior = inverse(covariance) / self.network_size
        predicted, row = own_range(self.space, state, measurement.position, measurement.age)
        measured = np.isfinite(measurement.range)
        innovation = np.where(measured, measurement.range - predicted, 0.0)
        variance = self.range_std**2
        spread = np.sqrt(np.sum(row * matvec(covariance, row), axis=1) + variance)
        weight = saturation(innovation, self.xi * spread)
        precision = np.where(measured, weight, 0.0) / variance
        vector = matvec(prior, state)
        vector += (precision * (innovation + np.sum(row * state, axis=1)))[:, None] * row
        matrix = prior + precision[:, None, None] * outer(row, row)
        payload = np.concatenate([vector, pack_upper(matrix)], axis=1)
        return Update(payload, np.where(measured, np.abs(innovation), np.nan), np.where(measured, weight, np.nan))

    def conclude(self, payload: Floats, own: Floats) -> Belief:
        """State and covariance from the averaged information.

        Accelerated averaging weighs some agents negatively, the more so where messages are lost, so now and then
        the result is no information matrix. The agent then keeps to its own, as if all messages had been lost.
        """
        size = self.motion.size
        eigenvalues = np.linalg.eigvalsh(unpack_upper(payload[:, size:], size))
        sound = eigenvalues[:, 0] > _LEAST * eigenvalues[:, -1]
        payload = np.where(sound[:, None], payload, own)
        covariance = inverse(unpack_upper(payload[:, size:], size))
        return Belief(matvec(covariance, payload[:, :size]), covariance / self.network_size)


def saturation(innovation: Floats, level: Floats) -> Floats:
    """Gain min(1, level/|innovation|) of the saturated innovation."""
    size = np.abs(innovation)
    return np.where(size <= level, 1.0, level / np.where(size > 0.0, size, 1.0))
