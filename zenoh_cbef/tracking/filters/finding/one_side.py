"""Agents in one plane that have lost sight of which side of it the target is on say so."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import matvec, pack_upper, unpack_upper
from zenoh_cbef.tracking.ranging import Measurement
from zenoh_cbef.tracking.status import ACQUIRING, TRACKING, Status

_FLAT = 1e-4
"""Agents are in one plane that are less off it than this share of how far they reach along it."""

_APART = 5.0
"""By how many claimed errors an estimate has to differ from its mirror image."""


@dataclass(frozen=True)
class OneSide(Wrapping):
    """Any filter that says what its estimate is worth, with the agents' places in its payload: p_i and p_i p_i^T.

        m, M      averages of both          n: of M - m m^T the direction of the least variance
        y = n^T (p - m, v),  Y: its covariance          flat: that variance is none
        u <- flat and (u or fixed and (2 y)^T Y^-1 (2 y) < 25)     fixed: the first fix is over

    Three agents, or more in one plane, measure the same of a place and of its mirror image. So only the way that the
    target came tells on which side of the plane it is. Where it comes so near to it, and crosses it so slowly, that
    place and velocity do not differ from their mirror images by five claimed errors, it may go on on either side: what
    the filter says from then on may be the mirror image. No range tells, so agents say `acquiring` for as long as
    they are in one plane. They may be a group that is cut off from others: averages are over those that are heard,
    and whatever the weights, three places are in one plane.
    """

    settings: FilterSettings

    @classmethod
    def numbers(cls, settings: FilterSettings) -> int:
        """How many numbers a payload has more."""
        axes = settings.space.axes
        return settings.says_status * settings.sides * (axes + axes * (axes + 1) // 2)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update, and where the agent is."""
        count, axes = len(belief.state), self.settings.space.axes
        inner = belief.parts[0] if belief.parts else belief
        update = self.filter.update(inner, measurement)
        place = measurement.position[:, :axes] - np.array(self.settings.middle)
        payload = np.concatenate([update.payload, place, pack_upper(place[:, :, None] * place[:, None, :])], axis=1)
        unsure = belief.memory[0] if belief.memory else np.zeros(count)
        said = belief.status or Status.first(count)
        return Update(payload, update.diagnostics, (unsure, *vars(said).values()), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, which is none of a side that is not known."""
        (unsure, *said), more = update.kept, self.numbers(self.settings)
        inner = self.filter.conclude(np.ascontiguousarray(payload[:, :-more]), update.parts[0])
        former, status = Status(*said), inner.status or Status(*said)
        flat, near = self._beside(inner, payload[:, -more:])
        rows = flat & ((unsure > 0.0) | (status.steps > self.settings.first_fix) & near)
        status = status.told(rows & (status.which == TRACKING), ACQUIRING, former, self.settings.motion.dt)
        memory = (rows.astype(np.float64),)
        return replace(inner, memory=memory, parts=(inner,), status=status, chance=None)

    def _beside(self, belief: Belief, places: Floats) -> tuple[Bools, Bools]:
        """Whether agents are in one plane, (n,), and whether the estimate may be its own mirror image."""
        axes = self.settings.space.axes
        middle = places[:, :axes]
        spread = unpack_upper(np.ascontiguousarray(places[:, axes:]), axes) - middle[:, :, None] * middle[:, None, :]
        sound = np.asarray(np.isfinite(spread).all(axis=(1, 2)))
        sizes, directions = np.linalg.eigh(np.where(sound[:, None, None], spread, 0.0))
        flat = sound & (sizes[:, 1] > _FLAT**2 * sizes[:, -1]) & (sizes[:, 0] < _FLAT**2 * sizes[:, -1])
        normal = np.ascontiguousarray(directions[:, :, 0])
        off = belief.state[:, :axes] - np.array(self.settings.middle) - middle
        height = np.add.reduce(normal * off, axis=1), np.add.reduce(normal * belief.state[:, axes : 2 * axes], axis=1)
        across = belief.known_covariance

        def variance(one: int, other: int) -> Floats:
            part = np.ascontiguousarray(across[:, one : one + axes, other : other + axes])
            return np.asarray(np.add.reduce(normal * matvec(part, normal), axis=1))

        first, both, second = variance(0, 0), variance(0, axes), variance(axes, axes)
        apart = height[0] ** 2 * second - 2.0 * height[0] * height[1] * both + height[1] ** 2 * first
        return flat, np.asarray(4.0 * apart < _APART**2 * (first * second - both * both))
