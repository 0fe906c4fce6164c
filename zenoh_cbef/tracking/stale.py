"""Averaging with neighbours' estimates of some steps ago, predicted forward to the present step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.consensus import Average
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.information_form import belief_of, pack, packed_size, predict
from zenoh_cbef.tracking.linalg import inverse, matvec
from zenoh_cbef.tracking.motion import Motion


@dataclass
class StaleAverage(Average):
    """y_i(l) = y_i(l-1) + sum_j w_ij (f(y_j(l-1) of `lag` steps ago) - y_i(l-1)): covariance intersection over time.

        f(V, O): (x, P) = (O^-1 V, O^-1), lag times  x <- A x, P <- A P A^T + Q,  (P^-1 x, P^-1)

    Payloads must be information that counts once: packed vectors and matrices of a posterior, as of `ci`. Information
    that such an estimate and the agent's own have in common then counts once at most, as in any covariance intersection
    (Julier, Uhlmann, ACC 1997), although the agent's own estimate rests on old ones. Numbers
    after the information are averaged as they are.

    motion: the model. lag: steps, at least 1.
    """

    motion: Motion
    lag: int

    def mix(self, received: Floats, delivered: Bools | None) -> Floats:
        """Average with the received, (n, m, d), of `lag` steps ago."""
        own = np.broadcast_to(self._value[:, None, :], received.shape)
        known = received if delivered is None else np.where(delivered[:, :, None], received, own)
        length = received.shape[2]
        carried = self._carried(known.reshape(-1, length), own.reshape(-1, length)).reshape(received.shape)
        return super().mix(carried, delivered)

    def _carried(self, payload: Floats, own: Floats) -> Floats:
        """Payloads (n, d) predicted forward; own: what stands in for one that is no information."""
        packed = packed_size(self.motion.size)
        belief = belief_of(payload[:, :packed], own[:, :packed], self.motion.size)
        for _ in range(self.lag):
            belief = Belief(*predict(self.motion, belief))
        information = inverse(belief.known_covariance)
        return np.concatenate([pack(matvec(information, belief.state), information), payload[:, packed:]], axis=1)
