"""Ranges are no straight lines: what linearising at an unsure estimate leaves out counts with their noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.returning import widened
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.information_form import predict
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Measurement, Space


@dataclass(frozen=True)
class Curving(Wrapping):
    """Any filter of the agent's own range, to whose noise the variance is added that linearising leaves out.

        sigma^2 <- sigma^2 + tr((G P)^2)/2,     G = (I - u u^T)/d

    P is what the estimate leaves open of the place before the range, d the distance, and G its second derivative
    (Bar-Shalom, Li and Kirubarajan, 2001, section 10.3). Where precise ranges are rare and the target turns fast, a
    filter that leaves this out takes good ranges for wrong ones.

    range_std: sigma (m), where a measurement does not say otherwise.
    """

    motion: Motion
    space: Space
    range_std: float

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update with the larger noise."""
        inner = belief.parts[0] if belief.parts else belief
        ahead = Belief(*predict(self.motion, Belief(inner.state, inner.known_covariance)))
        every = np.ones(len(inner.state), dtype=bool)
        return self.filter.update(inner, widened(every, self.space, ahead, measurement, self.range_std))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief."""
        inner = self.filter.conclude(payload, update)
        return replace(inner, memory=(), parts=(inner,), chance=None)
