"""An agent's ranges of several steps, linearised at one state of the target: what they tell of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.base import Belief, Shared, Tied
from zenoh_cbef.tracking.filters.finding.squared_ranges import Seen
from zenoh_cbef.tracking.filters.information_form import pack
from zenoh_cbef.tracking.linalg import BY_LIBRARY, Inversion, inverse, matvec, neighbour_sum, outer
from zenoh_cbef.tracking.ranging import Space, own_range


@dataclass(frozen=True)
class Wandering:
    """How far a target is off a straight line, backwards from its latest state: white acceleration, twice integrated.

        cov(a, b) = q^2 D a^2 (3 b - a)/6 on every axis,   a <= b, both s

    power: q^2 D, m^2/s^3. share: how many times an agent counts it. One target wanders for all agents: if each of n
    counted its way as noise of its own, their sum would claim n times too much. So each takes that noise for n times as
    large (Carlson's federated filter, IEEE TAES 26(3), 1990), or for n over the number of axes: agents see one axis
    each, and the trace of what all learn of the way is then as it should be.
    """

    power: float
    share: float

    def covariance(self, first: Floats, second: Floats) -> Floats:
        """Of two times, s, elementwise: m^2."""
        short, long = np.minimum(first, second), np.maximum(first, second)
        return np.asarray(self.power / 6.0 * short * short * (3.0 * long - short))


@dataclass(frozen=True)
class Remembered:
    """Ranges of k steps: rows (n, k, s), innovations and ages (n, k), whether measured (n, k). 0 where they were not.

    state: (n, s), where they are linearised. distance: (n, k), m, from there.
    """

    state: Floats
    distance: Floats
    rows: Floats
    innovation: Floats
    ages: Floats
    measured: Bools

    @classmethod
    def at(cls, space: Space, state: Floats, seen: Seen) -> Self:
        """Ranges that were seen, at states (n, s)."""
        count, kept = seen.ranges.shape
        predicted, rows = own_range(
            space, np.repeat(state, kept, axis=0), seen.positions.reshape(-1, 3), seen.ages.ravel()
        )
        measured = np.isfinite(seen.ranges)
        distance = predicted.reshape(count, kept)
        innovation = np.where(measured, seen.ranges - distance, 0.0)
        return cls(state, distance, rows.reshape(count, kept, -1), innovation, seen.ages, measured)

    def expected(self, covariance: Floats) -> Floats:
        """H P H^T of covariances (n, s, s): (n, k), m^2."""
        return np.asarray(np.sum(self.rows * matvec(covariance[:, None], self.rows), axis=2))

    @property
    def _equivalent(self) -> Floats:
        """What linear ranges would have been."""
        return np.asarray(self.innovation + np.sum(self.rows * self.state[:, None], axis=2))

    def information(self, weight: Floats, variance: Floats) -> tuple[Floats, Floats]:
        """Vector (n, s) and matrix (n, s, s) of ranges whose errors (n, k), m^2, are independent of one another."""
        precision = np.where(self.measured, weight, 0.0) / variance
        squares = outer(self.rows, self.rows)
        matrix = neighbour_sum((precision[:, :, None, None] * squares).reshape(*precision.shape, -1))
        vector = neighbour_sum((precision * self._equivalent)[:, :, None] * self.rows)
        return vector, matrix.reshape(-1, *squares.shape[2:])

    def newest(self, weight: Floats, variance: Floats, axes: int) -> Floats:
        """What the last range tells of the position, (n, axes), counted from where it is linearised; packed."""
        row = self.rows[:, -1, :axes]
        precision = np.where(self.measured[:, -1], weight[:, -1], 0.0) / variance[:, -1]
        vector = (precision * self.innovation[:, -1])[:, None] * row
        return pack(vector, precision[:, None, None] * outer(row, row))

    def joint_information(
        self,
        weight: Floats,
        variance: Floats,
        wandering: Wandering,
        axes: int,
        constant: float = 0.0,
        *,
        inversion: Inversion = BY_LIBRARY,
    ) -> tuple[Floats, Floats]:
        """The same of ranges that the target's way, besides, makes wrong together.

        constant: variance of an error that all ranges of an agent share, m^2. inversion: of the covariances.
        """
        if not self.measured.any():  # as in most parts of a large network
            count, size = self.state.shape
            return np.zeros((count, size)), np.zeros((count, size, size))
        noise = self._noise(weight, variance, wandering, axes)
        if constant:
            noise += constant * (self.measured[:, :, None] & self.measured[:, None])
        rows = np.where(self.measured[:, :, None], self.rows, 0.0)
        return inversion.information(rows, noise, self._equivalent)

    def shared(
        self,
        weight: Floats,
        variance: Floats,
        wandering: Wandering,
        axes: int,
        prior: Belief,
        *,
        agents: int,
        inversion: Inversion,
    ) -> Shared:
        """The same on (x, d, s), for an error d, m, that all ranges of an agent share, and one s for each metre.

        prior: what as many agents knew of x before, of which each tells its part.
        """
        errors = np.stack([np.ones_like(self.distance), self.distance], axis=2)
        rows = np.where(self.measured[:, :, None], np.concatenate([self.rows, errors], axis=2), 0.0)
        noise, size = self._noise(weight, variance, wandering, axes), self.rows.shape[2]
        vector, matrix = inversion.information(rows, noise, self._equivalent)
        known = inversion.inverse(prior.known_covariance) / agents
        vector[:, :size] += matvec(known, prior.state)
        matrix[:, :size, :size] += known
        return Shared(vector, matrix)

    def constant_given(
        self, weight: Floats, variance: Floats, wandering: Wandering, axes: int, constant: float
    ) -> Tied:
        """What the ranges say of such an error given x. constant: its variance before them, m^2."""
        noise = inverse(self._noise(weight, variance, wandering, axes))
        share = np.add.reduce(np.where(self.measured[:, :, None], noise, 0.0), axis=1) * self.measured
        left = 1.0 / (1.0 / constant + np.add.reduce(share, axis=1))
        gain = left[:, None] * share
        return Tied(np.add.reduce(gain * self._equivalent, axis=1), -matvec(self.rows.swapaxes(1, 2), gain), left)

    def _noise(self, weight: Floats, variance: Floats, wandering: Wandering, axes: int) -> Floats:
        """Covariance (n, k, k) of the errors of ranges, m^2."""
        rows = np.where(self.measured[:, :, None], self.rows, 0.0)
        alike = rows[:, :, :axes] @ rows[:, :, :axes].swapaxes(1, 2)
        # Beacons of a target that is heard at once are as old for all agents: their times are the same rows.
        ages = self.ages[:1] if (self.ages == self.ages[:1]).all() else self.ages
        noise = wandering.share * alike * wandering.covariance(ages[:, :, None], ages[:, None])
        steps = range(self.ages.shape[1])
        noise[:, steps, steps] += np.where(self.measured, variance / weight, 1.0)
        return noise


@dataclass(frozen=True)
class Rows:
    """Information of ranges, (n, s) and (n, s, s), their weights (n, k), and what is said of the latest, (n,).

    newest: what the latest alone tells of the position, packed.
    """

    vector: Floats
    matrix: Floats
    newest: Floats
    weight: Floats
    latest: Diagnostics

    def counted(self, often: Floats) -> Rows:
        """The same, of ranges that the network's information will hold so many times, (n,)."""
        once = 1.0 / often[:, None]
        vector, matrix, newest = self.vector * once, self.matrix * once[:, :, None], self.newest * once
        return replace(self, vector=vector, matrix=matrix, newest=newest)


def contamination(share: float, mean: float, level: Floats) -> Floats:
    """What outliers that are not told from ranges add to a range's variance, m^2.

    Those below the level, m, at which ranges saturate pass for ranges. Of exponential errors of this mean (m), for
    short levels, share/(1 - share) * integral of z^2/mean up to the level; for long ones all of them, of variance
    2 mean^2.
    """
    return np.asarray(share / (1.0 - share) * np.minimum(level**3 / (3.0 * mean), 2.0 * mean**2))
