"""Agents near one plane: the target and its mirror image, two hypotheses until the ranges tell them apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping, resumed
from zenoh_cbef.tracking.filters.base import Belief, Filter, Update
from zenoh_cbef.tracking.filters.rows import chosen
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import leading_trace
from zenoh_cbef.tracking.mirroring import Plane, Sides, mirrored
from zenoh_cbef.tracking.ranging import Measurement

_CUT = 9.0
"""Where a NIS is cut off, so that a single outlier does not decide."""

_DECIDED, _FORMERLY = 8.0, 5.0
"""Logarithm of how many times likelier a hypothesis is that the network believes: today, and by the rules before, by
which chance decided for the wrong side in some seeds of fifty.
"""

_MOST = 20.0
"""Where that logarithm is cut off, so that a target which crosses the plane is not held on the wrong side for long."""

_APART = 5.0
"""From how many claimed position errors on two places are two."""


@dataclass(frozen=True)
class MirrorImages(Wrapping):
    """Any filter of information twice, from an estimate and from its mirror image, in one payload, and one number more.

        l_i = (min(z'^2/S', 9) + ln S' - min(z^2/S, 9) - ln S)/2       dashes: of the filter that began at the image
        L <- cut(L + n times the average of l, 20)                     0 at first, as a guess proves nothing

    Ranges of agents in one plane fit a place and its mirror image. Of agents near one, both fit for long, and a filter
    that linearises at the wrong one stays there and is sure of it. So both go on, and L is the logarithm of how many
    times likelier the network's ranges made the first. An agent reports the likelier one, and while |L| < 8, and the
    two places are more than five claimed errors apart, it does not know which it is (`undecided`). Where the likelier
    one is so near the plane that it may be its own mirror image, the other one begins anew at that. It costs a second
    filter's payload, so it is for agents near a plane alone, or near a line in a plane.
    """

    settings: FilterSettings

    more = 1

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """Both filters' updates; what is told of ranges is of the likelier one."""
        first, second = belief.parts if len(belief.parts) > 1 else (belief, self.mirrored(belief))
        odds = belief.memory[0] if belief.memory else np.zeros(len(belief.state))
        here, there = self.filter.update(first, measurement), self.filter.update(second, measurement)
        gained = 0.5 * (_cost(there) - _cost(here))
        payload = np.concatenate([here.payload, there.payload, gained[:, None]], axis=1)
        return Update(payload, here.diagnostics.chosen(odds < 0.0, there.diagnostics), (odds,), (here, there))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The likelier belief."""
        here, there = update.parts
        split, (odds,) = here.payload.shape[1], update.kept
        first = self.filter.conclude(np.ascontiguousarray(payload[:, :split]), here)
        second = self.filter.conclude(np.ascontiguousarray(payload[:, split:-1]), there)
        gained = self.settings.network_size * np.nan_to_num(payload[:, -1])
        odds = np.fmax(np.fmin(odds + gained, _MOST), -_MOST)
        return self._joined(*self._begun_anew(first, second, odds))

    def resumed(self, belief: Belief) -> Belief:
        """A belief of another filter and its mirror image."""
        first, second = (resumed(self.filter, one) for one in (belief, self.mirrored(belief)))
        return self._joined(first, second, np.zeros(len(belief.state)))

    def near(self, belief: Belief) -> Bools:
        """Which estimates (n,) are so near the plane that the target may leave it on either side."""
        if not self.settings.crosses:
            return np.zeros(len(belief.state), dtype=bool)
        return Sides.of(belief.state, self._plane).unsure(belief.known_covariance)

    def _begun_anew(self, first: Belief, second: Belief, odds: Floats) -> tuple[Belief, Belief, Floats]:
        """Both beliefs, of which one is the other's mirror image where the target is near the plane, and odds of these.

        How the target came tells on which side it leaves, but no better than the likelier belief has it.
        """
        likelier = chosen(first, second, odds < 0.0)
        near = self.near(likelier)
        if not near.any():
            return first, second, odds
        image = _image(likelier, self._plane)
        known = np.fmin(np.abs(odds), Sides.of(likelier.state, self._plane).likelier(likelier.known_covariance))
        return chosen(first, likelier, near), chosen(second, image, near), np.where(near, known, odds)

    def _joined(self, first: Belief, second: Belief, odds: Floats) -> Belief:
        said = chosen(_plain(first), _plain(second), odds < 0.0)
        return replace(said, memory=(odds,), parts=(first, second))

    def mirrored(self, belief: Belief) -> Belief:
        """State and covariance of the mirror image."""
        return Belief(*mirrored(belief.state, belief.known_covariance, self._plane))

    @property
    def _plane(self) -> Plane:
        if self.settings.plane is None:
            raise ValueError("mirror images without a plane")
        return self.settings.plane


def _image(belief: Belief, plane: Plane) -> Belief:
    """The mirror image of a belief and of its parts."""
    state, covariance = mirrored(belief.state, belief.known_covariance, plane)
    parts = tuple(_image(one, plane) for one in belief.parts)
    return replace(belief, state=state, covariance=covariance, parts=parts)


def undecided(around: Filter, belief: Belief) -> Bools:
    """Which agents (n,) do not know on which side of a plane the target is."""
    while isinstance(around, Wrapping) and belief.parts:
        if isinstance(around, MirrorImages):
            first, second = belief.parts
            axes = around.settings.space.axes
            offset = (first.state - second.state)[:, :axes]
            variance = leading_trace(belief.known_covariance, axes)
            two = np.add.reduce(offset * offset, axis=1) > _APART**2 * variance
            # Agents of several motions would hardly ever track a target in the plane, and be as often falsely sure.
            two |= around.near(belief) & (not around.settings.models)
            decided = _DECIDED if around.settings.crosses else _FORMERLY
            return np.asarray(two & (np.abs(belief.memory[0]) < decided))
        around, belief = around.filter, belief.parts[0]
    return np.zeros(len(belief.state), dtype=bool)


def _plain(belief: Belief) -> Belief:
    return Belief(belief.state, belief.covariance, belief.bias)


def _cost(update: Update) -> Floats:
    """Twice the negative logarithm of how likely the own range was, (n,), but for a constant; 0 without one."""
    told = update.diagnostics
    there = np.isfinite(told.nis) & (told.nis > 0.0)
    nis = np.where(there, told.nis, 1.0)
    variance = np.where(there, told.innovation, 1.0) ** 2 / nis
    return np.asarray(np.where(there, np.minimum(nis, _CUT) + np.log(variance), 0.0))
