"""Where the target is if one receiver has an error of its own, for each receiver in turn, and how likely that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.linalg import inverse
from zenoh_cbef.tracking.ranging import Space

_ITERATIONS = 15
"""How often Levenberg and Marquardt's method tries to get lower."""

_LOOSE = 100.0
"""How many times wider than where the target may be its prior is: no information."""

_PAIR = 2
"""Numbers that an agent tells: its range and the range's rate."""


@dataclass(frozen=True)
class Told:
    """What agents of m networks told, (m, n, ...): whether they did, positions (3), range and rate (2), covariance."""

    known: Floats
    positions: Floats
    lines: Floats
    covariance: Floats


@dataclass(frozen=True)
class Supposed:
    """For each of h hypotheses: states (m, h, s), information (m, h, s, s), and twice -ln(likelihood), (m, h).

    The first leaves out no agent, hypothesis j + 1 leaves out agent j. at: (m, h), the same of the estimate that was
    there before. spare: (h,), how many numbers each has more than unknowns.
    """

    state: Floats
    information: Floats
    cost: Floats
    at: Floats
    spare: Floats


@dataclass(frozen=True)
class Hypotheses:
    """Nonlinear least squares on all agents' ranges and rates, once with all of them, and once without each.

        f_i(p, v) = (|p - p_i|, u_i^T v),  u_i = (p - p_i)/|p - p_i|
        cost = sum over i that are not left out of (z_i - f_i)^T C_i^-1 (z_i - f_i)

    A receiver with an error of its own tells nothing of the target, so the cost without it is twice -ln(likelihood) of
    that hypothesis, but for a constant. From the estimate, from the middle of where the target may be, and from the
    estimate's mirror image beyond that, by Levenberg and Marquardt's method; the lowest cost counts.

    anywhere: where the target may be if nothing is known, state (s,) and variance (s,).
    """

    space: Space
    anywhere: tuple[Floats, Floats]

    def all(self, told: Told, estimate: Floats) -> Supposed:
        """Of m networks. estimate: (m, s)."""
        runs, agents = told.lines.shape[:2]
        (middle, variance), size = self.anywhere, estimate.shape[1]
        starts = np.stack([estimate, np.broadcast_to(middle, estimate.shape), 2.0 * middle - estimate], axis=1)
        kept = np.vstack([np.ones((1, agents)), 1.0 - np.eye(agents)])
        many, count = len(kept), starts.shape[1]
        problem = _Problem.of(self.space, told, kept, variance, middle)
        state = np.broadcast_to(starts[:, :, None], (runs, count, many, size))
        state, cost = problem.lowest(state)
        best = np.argmin(cost, axis=1)
        state = np.take_along_axis(state, best[:, None, :, None], axis=1)[:, 0]
        _, information, cost = problem.at(state[:, None])
        here = np.broadcast_to(estimate[:, None, None], (runs, 1, many, size))
        spare = np.maximum(_PAIR * (told.known @ kept.T) - size, 1.0)
        return Supposed(state, information[:, 0], cost[:, 0], problem.at(here)[2][:, 0], spare)


@dataclass(frozen=True)
class _Problem:
    """Least squares of m networks, from a starts each, for h hypotheses: states (m, a, h, s)."""

    space: Space
    told: Told
    root: Floats
    kept: Floats
    precision: Floats
    middle: Floats

    @classmethod
    def of(cls, space: Space, told: Told, kept: Floats, variance: Floats, middle: Floats) -> _Problem:
        """With the prior variance (s,) around a state (s,)."""
        flat = told.covariance.reshape(-1, _PAIR, _PAIR)
        root = np.asarray(np.linalg.cholesky(inverse(flat)).swapaxes(1, 2)).reshape(told.covariance.shape)
        return cls(space, told, root, kept, _LOOSE**-2 / variance, middle)

    def at(self, state: Floats) -> tuple[Floats, Floats, Floats]:
        """Descent (..., s), information (..., s, s) and cost (...) at states."""
        axes, size = self.space.axes, state.shape[-1]
        flat = state.reshape(-1, size)
        here = self.space.position(flat).reshape(*state.shape[:-1], 1, 3)
        offset = here - self.told.positions[:, None, None]
        distance = np.sqrt(np.add.reduce(offset * offset, axis=-1))
        unit = (offset / np.where(distance > 0.0, distance, 1.0)[..., None])[..., :axes]
        velocity = state[..., None, axes:]
        rate = np.add.reduce(unit * velocity, axis=-1)
        rows = np.zeros((*distance.shape, _PAIR, size))
        rows[..., 0, :axes] = rows[..., 1, axes:] = unit
        rows[..., 1, :axes] = (velocity - rate[..., None] * unit) / np.maximum(distance, 1e-9)[..., None]
        wrong = self.told.lines[:, None, None] - np.stack([distance, rate], axis=-1)
        used = self.told.known[:, None] * self.kept
        scaled = self.root[:, None, None] * used[:, None, :, :, None, None]
        rows = (scaled @ rows).reshape(*state.shape[:-1], -1, size)
        wrong = (scaled @ wrong[..., None]).reshape(*state.shape[:-1], -1)
        back = rows.swapaxes(-1, -2)
        away = self.middle - state
        information = back @ rows + np.diag(self.precision)
        descent = (back @ wrong[..., None])[..., 0] + self.precision * away
        cost = np.add.reduce(wrong * wrong, axis=-1) + np.add.reduce(self.precision * away * away, axis=-1)
        return descent, information, cost

    def lowest(self, state: Floats) -> tuple[Floats, Floats]:
        """States and costs after the iterations."""
        diagonal = range(state.shape[-1])
        damping = np.full(state.shape[:-1], 1e-3)
        descent, information, cost = self.at(state)
        for _ in range(_ITERATIONS):
            damped = information.copy()
            damped[..., diagonal, diagonal] *= 1.0 + damping[..., None]
            tried = state + np.linalg.solve(damped, descent[..., None])[..., 0]
            there = self.at(tried)
            better: Bools = there[2] < cost
            state = np.where(better[..., None], tried, state)
            descent = np.where(better[..., None], there[0], descent)
            information = np.where(better[..., None, None], there[1], information)
            cost = np.where(better, there[2], cost)
            damping = np.where(better, 0.1 * damping, 10.0 * damping)
        return state, cost


def belief_at(supposed: Supposed, which: Floats) -> Belief:
    """State (m, s) and covariance of one hypothesis of each network; which: (m,), its number."""
    place = which.astype(np.int64)
    rows = np.arange(len(place))
    return Belief(supposed.state[rows, place], inverse(supposed.information[rows, place]))


def speed_of(belief: Belief, axes: int) -> Floats:
    """The speed that a belief allows for, (n,), m/s: that of its mean, and one standard deviation more."""
    velocity, known = belief.state[:, axes : 2 * axes], belief.known_covariance
    spread = np.add.reduce(known[:, range(axes, 2 * axes), range(axes, 2 * axes)], axis=1)
    return np.asarray(np.sqrt(np.add.reduce(velocity * velocity, axis=1) + spread))
