"""Least squares on squared ranges, which are linear in the position and its square: a fix without a first guess."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.information_form import belief_of, pack, packed_size
from zenoh_cbef.tracking.filters.weighing import saturation
from zenoh_cbef.tracking.linalg import inverse, matvec, neighbour_sum, outer
from zenoh_cbef.tracking.ranging import Measurement, Space

_LOOSE = 100.0
"""Prior standard deviation of |q|^2 and of its change, in squares of the unit (and seconds): no information."""


@dataclass(frozen=True)
class Frame:
    """Where positions are counted from, (n, axes), and the unit of length, (n,), both m."""

    middle: Floats
    unit: Floats


@dataclass(frozen=True)
class Seen:
    """Agents' positions (n, k, 3), ages and ranges (n, k) of k steps; NaN ranges are missing."""

    positions: Floats
    ages: Floats
    ranges: Floats

    @property
    def steps(self) -> int:
        """How many steps there are, k."""
        return int(self.ranges.shape[1])

    @staticmethod
    def nothing(count: int, steps: int) -> tuple[Floats, Floats, Floats]:
        """Positions, ages and ranges of so many agents in steps in which nothing was measured."""
        return np.zeros((count, steps, 3)), np.zeros((count, steps)), np.full((count, steps), np.nan)

    def followed_by(self, new: Seen, dt: float) -> Seen:
        """With what was seen a step of dt (s) later, besides."""
        positions, ages, ranges = self.positions, self.ages + dt, self.ranges
        pairs = (positions, new.positions), (ages, new.ages), (ranges, new.ranges)
        return Seen(*(np.concatenate(pair, axis=1) for pair in pairs))

    def later(self, new: Measurement, dt: float, **changes: Floats) -> Self:
        """A step of dt (s) later: with what was measured in it in place of the oldest, and with other changes."""
        shape = self.ages.shape
        positions, ages, ranges = np.empty((*shape, 3)), np.empty(shape), np.empty(shape)
        positions[:, :-1], positions[:, -1] = self.positions[:, 1:], new.position
        ages[:, :-1], ages[:, -1] = self.ages[:, 1:] + dt, new.age
        ranges[:, :-1], ranges[:, -1] = self.ranges[:, 1:], new.range
        return replace(self, positions=positions, ages=ages, ranges=ranges, **changes)


@dataclass(frozen=True)
class SquaredRanges:
    """A target at p = m + L q, with agents at p_i = m + L a_i: every squared range is a linear equation.

        (r_i^2 - (height differences)^2)/L^2 - |a_i|^2 = -2 a_i^T q + |q|^2 - t d|q|^2/dt

    linear in y = (q, |q|^2, d|q|^2/dt) (Smith and Abel, IEEE TASSP 35(12), 1987). Agents add their rows' information
    up by averaging; there is one solution wherever the agents' geometry shows the position, however far the guess m.
    A row's noise is 2 r sigma/L^2. The last term, with the range's age t, is the part of the target's motion that
    changes all ranges alike; the rest of its motion, noise of 2 |a_i| |v| t/L, is small where the agents are close
    together. Where rows are too few, the prior q ~ N(0, I) decides.

    network_size: n. xi: saturation of a row's residual in standard deviations, at the latest solution. rate: whether
    d|q|^2/dt is an unknown; ranges that are all new do without it. least: ranges below it, m, are none.
    """

    space: Space
    network_size: int
    xi: float
    rate: bool = True
    least: float = -np.inf

    @property
    def unknowns(self) -> int:
        """How many there are."""
        return self.space.axes + 1 + self.rate

    @property
    def size(self) -> int:
        """Numbers in a payload."""
        return packed_size(self.unknowns)

    def payload(
        self, frame: Frame, fix: Belief, seen: Seen, *, variance: Floats, speed: Floats, guess: Belief | None = None
    ) -> Floats:
        """The agent's share of the information on y, (n, size).

        fix: the latest position (n, axes), and its covariance, at which residuals are weighed. variance: of the
        ranges, m^2, as wide as (n, k). speed: (n,), standard deviation of the target's velocity along an axis, m/s.
        guess: an initial estimate of the position besides, (n, axes), with its covariance.
        """
        axes, unit = self.space.axes, frame.unit[:, None]
        measured = np.isfinite(seen.ranges) & (seen.ranges >= self.least)
        ranges = np.where(measured, seen.ranges, 0.0)
        at = (seen.positions[:, :, :axes] - frame.middle[:, None]) / unit[:, :, None]
        reach = np.sum(at * at, axis=2)
        square = ranges**2 / unit**2 - reach
        if self.space.height is not None:
            square -= (self.space.height - seen.positions[:, :, 2]) ** 2 / unit**2
        rows = np.concatenate([-2.0 * at, np.ones_like(at[:, :, :1]), -seen.ages[:, :, None]], axis=2)
        rows = rows[:, :, : self.unknowns]
        moved = speed[:, None] * seen.ages / unit
        noise = (2.0 * ranges / unit**2) ** 2 * variance + 2.0 * (variance / unit**2) ** 2
        noise = noise + 4.0 * reach * moved**2 + moved**4
        receding = (2.0 * ranges / unit * moved) ** 2
        if not self.rate:
            noise, receding = noise + receding, np.zeros_like(receding)
        place = (fix.state - frame.middle) / unit
        residual = square + 2.0 * np.sum(at * place[:, None], axis=2) - np.sum(place * place, axis=1)[:, None]
        slope = 2.0 * (place[:, None] - at) / unit[:, :, None]
        tolerance = noise + receding
        spread = np.sqrt(tolerance + np.sum(slope * matvec(fix.known_covariance[:, None], slope), axis=2))
        precision = np.where(measured, saturation(residual, self.xi * spread), 0.0) / noise
        information = neighbour_sum(precision[:, :, None] * outer(rows, rows).reshape(*measured.shape, -1))
        prior = np.zeros((len(unit), self.unknowns, self.unknowns))
        prior[:, range(axes), range(axes)] = 1.0 / self.network_size
        prior[:, axes, axes] = _LOOSE**-2 / self.network_size
        if self.rate:
            loose = np.full(len(unit), _LOOSE) if guess is None else _LOOSE * speed / frame.unit
            prior[:, -1, -1] = loose**-2 / self.network_size
        vector = neighbour_sum((precision * square)[:, :, None] * rows)
        matrix = information.reshape(prior.shape) + prior
        if guess is not None:
            known = inverse(guess.known_covariance / unit[:, :, None] ** 2) / self.network_size
            vector[:, :axes] += matvec(known, (guess.state - frame.middle) / unit)
            matrix[:, :axes, :axes] += known
        return pack(vector, matrix)

    def solve(self, payload: Floats, own: Floats, frame: Frame, *, joined: bool = False) -> Belief:
        """Position and its covariance from averaged payloads; own: the agent's, to fall back on.

        joined: whether the unknown |q|^2 is the square of the unknown q. It is, to first order about the solution for
        which it is none, q ~ N(m, C):  |q|^2 = 2 m^T q - |m|^2 + tr C + d,  d ~ N(0, 2 tr C^2).
        """
        axes, unit = self.space.axes, frame.unit[:, None]
        solved = belief_of(payload[:, : self.size], own[:, : self.size], self.unknowns)
        state, spread = solved.state, solved.known_covariance / self.network_size
        if joined:
            place, wide = state[:, :axes], spread[:, :axes, :axes]
            row = np.zeros_like(state)
            row[:, :axes], row[:, axes] = -2.0 * place, 1.0
            flat, cross = wide.reshape(len(wide), -1), matvec(spread, row)
            level = np.add.reduce(wide[:, range(axes), range(axes)], axis=1) - np.add.reduce(place * place, axis=1)
            variance = np.add.reduce(row * cross, axis=1) + 2.0 * np.add.reduce(flat * flat, axis=1)
            gain = cross / variance[:, None]
            state = state + gain * (level - np.add.reduce(row * state, axis=1))[:, None]
            spread = spread - outer(gain, cross)
        return Belief(frame.middle + unit * state[:, :axes], unit[:, :, None] ** 2 * spread[:, :axes, :axes])
