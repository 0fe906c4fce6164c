"""Agents in one plane that have lost sight of which side of it the target is on say so."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.finding.beside import Beside
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import pack_upper
from zenoh_cbef.tracking.mirroring import APART
from zenoh_cbef.tracking.ranging import Measurement
from zenoh_cbef.tracking.status import ACQUIRING, LOST, TRACKING, Status, proof

_NEAR = 3.0
"""How far off a plane agents are, root mean square in units of the noise, whose ranges soon tell the side: as in
scenario/near_plane.py.
"""


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

    By today's rules (settings.proves_sides) the side has to be proved:

    - At first by the guesses, as ranges of a first fix tell no side either. In the first step agents tell these in
      place of their places. Until the target is tracked, y carried back to the start has to differ from its mirror
      image as far by what the mean of all guesses is worth, and the place to be where that allows.
    - Later by ranges that fit, as many as prove a first place, of agents that are off the plane by 3 sigma. A filter on
      the wrong side first takes those of one more agent for outliers, and it may be gone before that shows.
    - Where receivers may fall silent (settings.hearers_count), only the places of those agents count that have heard
      the target lately, with one number more. If these were too few for long, it may be on either side of them.
    """

    settings: FilterSettings

    @classmethod
    def numbers(cls, settings: FilterSettings) -> int:
        """How many numbers a payload has more."""
        axes = settings.space.axes
        return settings.says_status * settings.sides * (axes + axes * (axes + 1) // 2 + settings.hearers_count)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update, and where the agent is."""
        count, axes = len(belief.state), self.settings.space.axes
        inner = belief.parts[0] if belief.parts else belief
        update = self.filter.update(inner, measurement)
        begins = self.settings.proves_sides and not belief.memory
        place = self._centred(belief.state if begins else measurement.position)[:, :axes]
        told = np.concatenate([place, pack_upper(place[:, :, None] * place[:, None, :])], axis=1)
        missing, guess = belief.memory or (np.zeros(count), np.zeros((count, axes)))
        said = belief.status or Status.first(count)
        if self.settings.hearers_count:
            lately = said.hearing(np.isfinite(measurement.range)).unheard < self.settings.hearing
            told = np.concatenate([told, np.ones((count, 1))], axis=1) * lately[:, None]
        payload = np.concatenate([update.payload, told], axis=1)
        return Update(payload, update.diagnostics, (missing, guess, *vars(said).values()), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, which is none of a side that is not known."""
        (missing, guess, *said), more = update.kept, self.numbers(self.settings)
        inner = self.filter.conclude(np.ascontiguousarray(payload[:, :-more]), update.parts[0])
        former, status = Status(*said), inner.status or Status(*said)
        state, told = self._centred(inner.state), self._average(payload[:, -more:])
        proves = self.settings.proves_sides
        beside = Beside.of(state, told, proves * _NEAR * self.settings.range_std)
        unsure = beside.sides.unsure(inner.known_covariance)
        if proves:
            guess = np.where(former.steps[:, None] > 0.0, guess, told[:, : guess.shape[1]])
            unsure |= (status.which == LOST) | (
                (former.which == ACQUIRING) & ~self._guessed(state, guess, beside, status)
            )
        unsure &= beside.plane & (status.steps > self.settings.first_fix)
        missing = self._missing(missing, unsure, beside, former, status)
        rows = (missing > 0.0) & (status.which == TRACKING)
        status = status.told(rows, ACQUIRING, former, self.settings.motion.dt)
        return replace(inner, memory=(missing, guess), parts=(inner,), status=status, chance=None)

    def _missing(self, missing: Floats, unsure: Bools, beside: Beside, former: Status, status: Status) -> Floats:
        """How many ranges have to fit until the side is known, (n,)."""
        if not self.settings.proves_sides:
            return np.asarray(beside.plane & ((missing > 0.0) | unsure), dtype=np.float64)
        fitted = np.maximum(status.heard - former.heard, 0.0)
        most = float(proof(self.settings.space.axes, self.settings.network_size))
        left = np.where(beside.flat, missing, np.maximum(missing - fitted, 0.0))
        return np.where(unsure | (beside.flat & status.scarcely_heard), most, left)

    def _guessed(self, state: Floats, guess: Floats, beside: Beside, status: Status) -> Bools:
        """Whether guesses tell the side of an estimate, and do not deny it, (n,)."""
        settings, axes, age = self.settings, self.settings.space.axes, self.settings.motion.dt * status.steps
        place, speed = settings.guessed or (np.inf, np.inf)
        # A white acceleration, twice integrated.
        strays = settings.motion.acceleration_std**2 * settings.motion.dt * age**3 / 3.0
        std = np.sqrt(place**2 + strays)
        off = state[:, :axes] - age[:, None] * state[:, axes : 2 * axes] - guess
        there = np.add.reduce(off * off, axis=1) < (APART * std) ** 2
        return np.asarray(there & beside.sides.proved(age, std, speed))

    def _average(self, told: Floats) -> Floats:
        """Of agents that count."""
        if not self.settings.hearers_count:
            return told
        share = told[:, -1:]
        return told[:, :-1] / np.where(share > 0.0, share, np.inf)

    def _centred(self, states: Floats) -> Floats:
        """States that begin with a place, (n, axes or more), as seen from the middle."""
        axes = self.settings.space.axes
        return np.concatenate([states[:, :axes] - np.array(self.settings.middle), states[:, axes:]], axis=1)
