"""The Kalman-consensus filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.state_form import LinearisedRanges
from zenoh_cbef.tracking.linalg import matvec, neighbour_sum
from zenoh_cbef.tracking.ranging import Measurement


@dataclass(frozen=True)
class KalmanConsensus(LinearisedRanges):
    """KCF of Olfati-Saber ("Kalman-consensus filter: optimality, stability, and performance", CDC 2009).

        M_i    = (P_i^-1 + S_i)^-1,   S_i = sum_j U_j,   y_i = sum_j u_j      j = i and its neighbours
        xhat_i = x_i + M_i (y_i - S_i x_i) + gamma_i P_i sum_{j in N_i} (x_j - x_i),   gamma_i = epsilon/(1 + |P_i|)

    x_i, P_i: prior. |P|: Frobenius norm. The paper's message (u_j, U_j, x_j) comes in two: u_j and U_j are made of
    the neighbour's position and range, which it sends before the update, and are linearised at the receiver's own
    prior. The payload is the prior x_i. One round of averaging with uniform weights epsilon returns
    x_i + epsilon sum_j (x_j - x_i), so what consensus changed, times P_i/(1 + |P_i|), is the paper's last term to the
    letter; other weights put w_ij in place of epsilon, and more rounds let farther agents pull.

    Known to be inconsistent: M_i ignores the consensus term and that neighbours share their measurements. There is no
    saturation, so outliers hit it in full. range_std: sigma (m).
    """

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The payload is the prior state (n, s); what the neighbourhood measured waits for the end of the step."""
        state, covariance, updated, heard = self.informed(belief, measurement)
        # Summed as neighbours are, as any other order may differ between a batch and an agent alone.
        norm = np.sqrt(neighbour_sum((covariance * covariance).reshape(len(state), -1)))
        pull = covariance / (1.0 + norm)[:, None, None]
        kept = (state + matvec(updated, heard.vector), updated, pull)
        return Update(state, heard.diagnostics, kept)

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The measurement update, pulled towards the neighbours' priors."""
        state, covariance, pull = update.kept
        return Belief(state + matvec(pull, payload - update.payload), covariance)
