"""Agents near one plane: the target and its mirror image, two hypotheses until the ranges tell them apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.auto_bias import AutoBias, mixed
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping, inner_of, resumed
from zenoh_cbef.tracking.filters.base import Belief, Filter, Update
from zenoh_cbef.tracking.filters.models.biased_information import BiasedInformation
from zenoh_cbef.tracking.filters.models.joint_biases import JointBiases
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

    With settings.blends, where ranges are real, |L| = 20 decides against a hypothesis for a while only: ranges that are
    wrong for long decide, too, so that one begins anew at the likelier one's mirror image. And two that are less than
    five claimed errors apart are one place, that of their mixture with the odds L, while the network hears ranges;
    in a silence the likelier one itself covers both sides.

    informs: how many numbers the filter's payload begins with that are information; both filters' stand first.
    """

    settings: FilterSettings
    informs: int

    more = 1

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """Both filters' updates; what is told of ranges is of the likelier one."""
        first, second = belief.parts if len(belief.parts) > 1 else (belief, self.mirrored(belief))
        none = np.zeros(len(belief.state))
        odds, silent = belief.memory or (none, none)
        here, there = self.filter.update(first, measurement), self.filter.update(second, measurement)
        both, gained = (here.payload, there.payload), 0.5 * (_cost(there) - _cost(here))
        parts = [one[:, : self.informs] for one in both] + [one[:, self.informs :] for one in both]
        payload = np.concatenate([*parts, gained[:, None]], axis=1)
        return Update(payload, here.diagnostics.chosen(odds < 0.0, there.diagnostics), (odds, silent), (here, there))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The likelier belief, or the mixture of both."""
        (here, there), (odds, silent) = update.parts, update.kept
        more = payload.shape[1] // 2 - self.informs
        ends = self.informs, 2 * self.informs, 2 * self.informs + more
        one, other, *rest = np.split(payload[:, :-1], ends, axis=1)
        first = self.filter.conclude(np.concatenate([one, rest[0]], axis=1), here)
        second = self.filter.conclude(np.concatenate([other, rest[1]], axis=1), there)
        gained = self.settings.network_size * np.nan_to_num(payload[:, -1])
        odds = np.fmax(np.fmin(odds + gained, _MOST), -_MOST)
        silent = np.where(gained == 0.0, silent + 1.0, 0.0)
        return self.joined(*self.begun_anew(first, second, odds), silent)

    def resumed(self, belief: Belief) -> Belief:
        """A belief of another filter and its mirror image."""
        first, second = (resumed(self.filter, one) for one in (belief, self.mirrored(belief)))
        none = np.zeros(len(belief.state))
        return self.joined(first, second, none, none)

    def near(self, belief: Belief) -> Bools:
        """Which estimates (n,) are so near the plane that the target may leave it on either side."""
        if not self.settings.crosses:
            return np.zeros(len(belief.state), dtype=bool)
        return Sides.of(belief.state, self._plane).unsure(belief.known_covariance)

    def apart(self, belief: Belief) -> Bools:
        """Of which agents (n,) the two hypotheses are more than five of the claimed errors from each other."""
        (first, second), axes = belief.parts, self.settings.space.axes
        offset = (first.state - second.state)[:, :axes]
        variance = leading_trace(belief.known_covariance, axes)
        return np.asarray(np.add.reduce(offset * offset, axis=1) > _APART**2 * variance)

    def begun_anew(self, first: Belief, second: Belief, odds: Floats) -> tuple[Belief, Belief, Floats]:
        """Both beliefs, of which one is the other's mirror image where the target is near the plane, and odds of these.

        How the target came tells on which side it leaves, but no better than the likelier belief has it.
        """
        likelier = chosen(first, second, odds < 0.0)
        anew = self.near(likelier)
        if self.settings.blends:
            anew |= np.abs(odds) >= _MOST
        if not anew.any():
            return first, second, odds
        image = _image(self.filter, likelier, self._plane)
        known = np.fmin(np.abs(odds), Sides.of(likelier.state, self._plane).likelier(likelier.known_covariance))
        return chosen(first, likelier, anew), chosen(second, image, anew), np.where(anew, known, odds)

    def joined(self, first: Belief, second: Belief, odds: Floats, silent: Floats) -> Belief:
        """What an agent says of both hypotheses. odds: L. silent: steps without a range, (n,) each."""
        said = chosen(_plain(first), _plain(second), odds < 0.0)
        whole = replace(said, memory=(odds, silent), parts=(first, second))
        if not self.settings.blends:
            return whole
        state, covariance = mixed(first, second, 1.0 / (1.0 + np.exp(odds)))
        one = ~self.apart(whole) & (silent <= self.settings.sudden)
        return chosen(whole, replace(whole, state=state, covariance=covariance), one)

    def mirrored(self, belief: Belief) -> Belief:
        """State and covariance of the mirror image."""
        return Belief(*mirrored(belief.state, belief.known_covariance, self._plane))

    @property
    def _plane(self) -> Plane:
        if self.settings.plane is None:
            raise ValueError("mirror images without a plane")
        return self.settings.plane


def _image(chosen: Filter, belief: Belief, plane: Plane) -> Belief:
    """The mirror image of a filter's belief and of its parts."""
    state, covariance = mirrored(belief.state, belief.known_covariance, plane)
    there = replace(belief, state=state, covariance=covariance)
    if isinstance(chosen, BiasedInformation | JointBiases):
        return replace(there, memory=chosen.mirrored(belief.memory, plane))
    inside = (chosen.plain, chosen.biased) if isinstance(chosen, AutoBias) else (inner_of(chosen),) * len(belief.parts)
    return replace(there, parts=tuple(_image(*each, plane) for each in zip(inside, belief.parts, strict=True)))


def undecided(around: Filter, belief: Belief) -> Bools:
    """Which agents (n,) do not know on which side of a plane the target is."""
    while isinstance(around, Wrapping) and belief.parts:
        if isinstance(around, MirrorImages):
            two = around.apart(belief)
            # Agents of several motions would hardly ever track a target in the plane, and be as often falsely sure.
            if not (around.settings.models or around.settings.blends):
                two |= around.near(belief)
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
