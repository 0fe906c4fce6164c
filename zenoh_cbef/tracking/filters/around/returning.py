"""An agent that was alone for a while does not pull the network to where it has drifted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.information_form import unchanged, variance_of
from zenoh_cbef.tracking.ranging import Measurement, Space, own_range

FEW_BEND = 20.0
"""How many times the variance that linearising leaves out few agents add, as their errors last from step to step."""

ALONE_BEND = 100.0
"""The same of an agent that is alone, whose errors last longer."""


@dataclass(frozen=True)
class Returning(Wrapping):
    """Any filter of the agent's own range, which counts less in the step after one in which no neighbour was heard.

        sigma^2 <- sigma^2 + tr((G P)^2)/2,     G = (I - u u^T)/r, the range's second derivative at the estimate

    An agent alone goes on by prediction, and is soon unsure by more than its range is straight. Linearised there, its
    range says with the certainty of its noise what is wrong by metres, and all agents that it meets again believe it.
    The added term is the variance of what linearising leaves out (Bar-Shalom, Li and Kirubarajan, 2001, section 10.3).
    In the step after that the agent has its neighbours' estimate, and its range counts in full.

    range_std: sigma (m), where a measurement does not say otherwise. newcomers: whether an agent that begins
    with its neighbours' estimate takes them to have been alone.
    """

    space: Space
    range_std: float
    newcomers: bool = False

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update."""
        inner = belief.parts[0] if belief.parts else belief
        if belief.memory:
            measurement = widened(belief.memory[0] > 0.0, self.space, inner, measurement, self.range_std)
        return self.filter.update(inner, measurement)

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, and whether no neighbour was heard."""
        inner = self.filter.conclude(payload, update)
        alone = unchanged(payload, update.payload).astype(np.float64)
        return replace(inner, memory=(alone,), parts=(inner,), chance=None)

    def resumed(self, belief: Belief) -> Belief:
        """A belief of neighbours, in the form that this filter carries from step to step."""
        begun = super().resumed(belief)
        return replace(begun, memory=(np.ones(len(belief.state)),)) if self.newcomers else begun


def widened(
    rows: Bools,
    space: Space,
    belief: Belief,
    measurement: Measurement,
    range_std: float,
    *,
    times: Floats | float = 1.0,
) -> Measurement:
    """A measurement of which the ranges in some rows (n,) have so many times the variance of their bend more.

    range_std: m, where a measurement does not say otherwise. times: (n,), or one number.
    """
    if not rows.nonzero()[0].size:
        return measurement
    added = np.where(rows, times * bend(space, belief, measurement), 0.0)
    return replace(measurement, range_std=np.sqrt(variance_of(measurement, range_std) + added))


def bend(space: Space, belief: Belief, measurement: Measurement) -> Floats:
    """Variance of a range over its linearisation at a belief, (n,), m^2."""
    axes = space.axes
    distance, row = own_range(space, belief.state, measurement.position, np.zeros(len(belief.state)))
    direction = np.ascontiguousarray(row[:, :axes])
    across = np.eye(axes) - direction[:, :, None] * direction[:, None, :]
    place = np.ascontiguousarray(belief.known_covariance[:, :axes, :axes])
    curved = across @ place / np.maximum(distance, np.finfo(np.float64).tiny)[:, None, None]
    square = (curved * np.swapaxes(curved, 1, 2)).reshape(len(curved), -1)
    return np.asarray(0.5 * np.add.reduce(square, axis=1))
