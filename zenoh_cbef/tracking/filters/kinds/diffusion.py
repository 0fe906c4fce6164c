"""The diffusion Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.state_form import LinearisedRanges
from zenoh_cbef.tracking.linalg import matvec
from zenoh_cbef.tracking.ranging import Measurement


@dataclass(frozen=True)
class Diffusion(LinearisedRanges):
    """Diffusion Kalman filter of Cattivelli and Sayed (IEEE TAC 55(9), 2010), on linearised ranges.

        incremental:  P_i   = (P_i^-1 + sum_j U_j)^-1                                 j = i and its neighbours
                      psi_i = x_i + P_i sum_j H_j^T (r_j - h_j(x_i))/sigma^2
        diffusion:    xhat_i = sum_j c_ij psi_j,   P_i as it is

    x_i, P_i: prior. Neighbours send position and range before the update, and psi after it. The combination is the
    consensus stage: C = W, or W^L with L rounds; its rows sum to one, as the paper asks.

    Known to be inconsistent, as the paper says: P_i is not the covariance of the combined estimate. There is no
    saturation, so outliers hit it in full. range_std: sigma (m).
    """

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The incremental update; the payload is psi (n, s)."""
        state, _, updated, heard = self.informed(belief, measurement)
        psi = state + matvec(updated, heard.vector)
        return Update(psi, heard.diagnostics, (updated,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The combined state, with the covariance of before."""
        return Belief(payload, update.kept[0])
