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
from zenoh_cbef.tracking.status import ACQUIRING, LOST, TRACKING, Status, proof

_FLAT = 1e-4
"""Agents are in one plane that are less off it than this share of how far they reach along it."""

_NEAR = 3.0
"""How far off it they are, root mean square in units of the noise, if their ranges soon tell the side: as near_plane's.
"""

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

    By today's rules (settings.guessed) ranges of the first fix tell no side either, but the guesses do: y carried back
    to the start has to differ as far by what the mean of all guesses is worth, and to be where the own guess allows.
    And where receivers may fall silent, only those places count of which the target was heard lately, with one number
    more; if they were too few for long, it may have come to either side of them.
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
        place = measurement.position[:, :axes] - np.array(self.settings.middle)
        told = np.concatenate([place, pack_upper(place[:, :, None] * place[:, None, :])], axis=1)
        missing, guess = belief.memory or (np.zeros(count), belief.state[:, :axes])
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
        flat, near = self._beside(inner, payload[:, -more:], status, guess)
        fitted = np.maximum(status.heard - former.heard, 0.0) if self.settings.proves_sides else np.inf
        missing = np.where(flat, missing, np.maximum(missing - fitted, 0.0))
        lost = flat & (status.steps > self.settings.first_fix) & near
        missing = np.where(lost, proof(self.settings.space.axes, self.settings.network_size), missing)
        rows = (missing > 0.0) & (status.which == TRACKING)
        status = status.told(rows, ACQUIRING, former, self.settings.motion.dt)
        memory = missing, guess
        return replace(inner, memory=memory, parts=(inner,), status=status, chance=None)

    def _beside(self, belief: Belief, told: Floats, status: Status, guess: Floats) -> tuple[Bools, Bools]:
        """Whether agents are in one plane, (n,), and whether the target may be on either side of it."""
        axes = self.settings.space.axes
        if self.settings.hearers_count:
            share = told[:, -1:]
            told = told[:, :-1] / np.where(share > 0.0, share, np.inf)
        middle = told[:, :axes]
        spread = unpack_upper(np.ascontiguousarray(told[:, axes:]), axes) - middle[:, :, None] * middle[:, None, :]
        sound = np.asarray(np.isfinite(spread).all(axis=(1, 2)))
        sizes, directions = np.linalg.eigh(np.where(sound[:, None, None], spread, 0.0))
        least = _FLAT**2 * sizes[:, -1]
        if self.settings.proves_sides:
            least = np.maximum(least, (_NEAR * self.settings.range_std) ** 2)
        flat = sound & (sizes[:, 0] <= least)
        plane = flat & (sizes[:, 1] > _FLAT**2 * sizes[:, -1])
        normal = np.ascontiguousarray(directions[:, :, 0])
        off = belief.state[:, :axes] - np.array(self.settings.middle) - middle
        height = np.add.reduce(normal * off, axis=1)
        rise = np.add.reduce(normal * belief.state[:, axes : 2 * axes], axis=1)
        near = plane & self._near(belief.known_covariance, normal, height, rise)
        if self.settings.guessed is not None:
            age = self.settings.motion.dt * status.steps
            begun = status.steps == self.settings.first_fix + 1.0
            start = belief.state[:, :axes] - age[:, None] * belief.state[:, axes : 2 * axes]
            near |= plane & begun & ~self._told(height - age * rise, rise, start - guess)
            near |= status.which == LOST
        if self.settings.hearers_count:
            near |= status.scarcely_heard
        return (flat if self.settings.proves_sides else plane), near

    @staticmethod
    def _near(covariance: Floats, normal: Floats, height: Floats, rise: Floats) -> Bools:
        """Whether an estimate may be its own mirror image, (n,). height, m, and rise, m/s: along the normal, (n,)."""
        axes = normal.shape[1]

        def variance(one: int, other: int) -> Floats:
            part = np.ascontiguousarray(covariance[:, one : one + axes, other : other + axes])
            return np.asarray(np.add.reduce(normal * matvec(part, normal), axis=1))

        first, both, second = variance(0, 0), variance(0, axes), variance(axes, axes)
        apart = height**2 * second - 2.0 * height * rise * both + rise**2 * first
        return np.asarray(4.0 * apart < _APART**2 * (first * second - both * both))

    def _told(self, height: Floats, rise: Floats, off: Floats) -> Bools:
        """Whether guesses tell the side of a target that began so high, (n,), and so far off the own guess, (n, axes)."""
        settings = self.settings
        place, speed = settings.guessed or (np.inf, np.inf)
        own = place**2 * (settings.guesses or (1, 1))[0]
        apart = 4.0 * ((height / place) ** 2 + (rise / speed) ** 2)
        return np.asarray((apart >= _APART**2) & (np.add.reduce(off * off, axis=1) < _APART**2 * own))
