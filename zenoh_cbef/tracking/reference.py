"""The yardsticks, offline: the centralised filter that sees every range at once, and the posterior bound."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.information_form import predict
from zenoh_cbef.tracking.filters.weighing import weigh
from zenoh_cbef.tracking.linalg import inverse, matvec
from zenoh_cbef.tracking.motion import LinearMotion, Motion
from zenoh_cbef.tracking.outliers import Errors
from zenoh_cbef.tracking.ranging import Space, own_range
from zenoh_cbef.tracking.switching import Gaussian

_ROWS = 50_000
"""Ranges that are looked at together."""


@dataclass(frozen=True)
class Ranges:
    """One step of r runs: positions (r, n, 3), ranges, ages and their noise (r, n); NaN ranges are missing."""

    position: Floats
    range: Floats
    age: Floats
    std: Floats


@dataclass(frozen=True)
class Taken:
    """All agents' ranges of a step taken in by the filter of one motion, for r runs.

    prior, posterior: states (r, s) and covariances (r, s, s). innovation (m): (r, n), 0 where nothing was measured.
    spread: its standard deviation as predicted, m, (r, n). measured: (r, n). costs: of the ranges at
    the prior, (r, n). pull: their part of the information vector, (r, s).
    """

    prior: Gaussian
    posterior: Gaussian
    innovation: Floats
    spread: Floats
    measured: Bools
    costs: Floats
    pull: Floats

    @property
    def nis(self) -> Floats:
        """The innovation squared in units of its predicted variance, (r, n), NaN where nothing was measured."""
        return np.where(self.measured, (self.innovation / self.spread) ** 2, np.nan)

    @property
    def cost(self) -> Floats:
        """What `misfit` asks for, (r,)."""
        return np.asarray(np.sum(self.costs, axis=1) - np.sum((self.posterior[0] - self.prior[0]) * self.pull, axis=1))


def taken_in(
    belief: Belief,
    motion: Motion,
    space: Space,
    seen: Ranges,
    *,
    xi: float,
    power: int = 1,
    widens: float = 0.0,
    outliers: Errors | None = None,
    biases: int | None = None,
) -> Taken:
    """One step of the extended information filter on all agents' ranges, for r runs at once.

    belief: (r, s), (r, s, s). Each range is saturated at xi of its own standard deviations, as in sicf; infinite xi
    turns that off. power: of the saturation. widens: see `saturated_precision`. outliers: in place of all three.
    biases: where those of all agents begin in a state; None: it has none.
    """
    state, covariance = predict(motion, belief)
    (predicted, rows), measured = _expected(space, state, seen, biases), np.isfinite(seen.range)
    innovation = np.where(measured, seen.range - predicted, 0.0)
    variance = seen.std**2
    spread = np.sqrt(np.add.reduce(rows * (rows @ covariance), axis=2) + variance)
    weighed = weigh(
        *(innovation, spread, variance, measured, variance), xi=xi, power=power, widens=widens, outliers=outliers
    )
    precision = weighed.precision
    weight = np.where(measured, precision * variance if widens else weighed.weight, 1.0)
    if weighed.cost is None:
        cost = precision * innovation**2 - np.log(weight)
    else:  # Less what a range costs that is as expected: as above, that costs nothing.
        cost = measured * (weighed.cost - np.log(2.0 * np.pi * variance))
    weighted = precision[:, :, None] * rows
    # Where the target is lost by far, a covariance may be so long in one direction that it is singular: that run ends.
    updated = inverse(inverse(covariance) + weighted.swapaxes(1, 2) @ rows)
    pull = np.add.reduce(weighted * innovation[:, :, None], axis=1)
    if weighed.more is not None:
        pull += np.add.reduce(weighed.more[:, :, None] * rows, axis=1)
    posterior = state + matvec(updated, pull), updated
    return Taken(
        prior=(state, covariance),
        posterior=posterior,
        innovation=innovation,
        spread=spread,
        measured=measured,
        costs=cost,
        pull=pull,
    )


def _expected(space: Space, state: Floats, seen: Ranges, biases: int | None) -> tuple[Floats, Floats]:
    """Ranges (r, n) that states (r, s) make expected, and their gradients (r, n, s)."""
    runs, agents = seen.range.shape
    predicted, rows = own_range(space, np.repeat(state, agents, axis=0), seen.position.reshape(-1, 3), seen.age.ravel())
    predicted, rows = predicted.reshape(runs, agents), rows.reshape(runs, agents, -1)
    if biases is not None:
        rows[:, range(agents), range(biases, biases + agents)] = 1.0
        predicted = predicted + state[:, biases : biases + agents]
    return predicted, rows


def each_step(*, positions: Floats, ranges: Floats, age: Floats, range_std: float) -> Iterator[Ranges]:
    """What r runs measured, step by step. positions: (r, n, K, 3), m. ranges, age: (r, n, K), m and s."""
    std = np.full(ranges.shape[:2], range_std)
    known = np.where(np.isnan(age), 0.0, age)  # An age that is not known counts as none.
    for k in range(ranges.shape[2]):
        yield Ranges(positions[:, :, k], ranges[:, :, k], known[:, :, k], std)


def centralized_beliefs(
    initial: Belief,
    motion: Motion,
    space: Space,
    steps: Iterable[Ranges],
    *,
    xi: float,
    power: int = 1,
    widens: float = 0.0,
    outliers: Errors | None = None,
) -> Iterator[Belief]:
    """The centralised filter's beliefs of K steps, for r runs. initial: (r, s), (r, s, s)."""
    belief = initial
    for seen in steps:
        taken = taken_in(belief, motion, space, seen, xi=xi, power=power, widens=widens, outliers=outliers)
        belief = Belief(*taken.posterior)
        yield belief


def stacked(space: Space, beliefs: Iterable[Belief]) -> tuple[Floats, Floats]:
    """Positions and velocities of K steps: states (r, K, 6) and covariances (r, K, 6, 6)."""
    parts = [(space.embed_state(one.state), space.embed_covariance(one.known_covariance)) for one in beliefs]
    states, covariances = zip(*parts, strict=True)
    return np.stack(states, axis=1), np.stack(covariances, axis=1)


def posterior_bound(
    initial_covariance: Floats,
    motion: LinearMotion,
    space: Space,
    *,
    truth: Floats,
    positions: Floats,
    measured: Bools,
    age: Floats,
    range_std: float,
) -> Floats:
    """Posterior Cramer-Rao bound along a known truth, (r, K, 6, 6): no unbiased tracker's covariance is smaller.

    J(k+1) = (Q + A J(k)^-1 A^T)^-1 + sum_i H_i^T H_i / sigma^2, H_i at the truth (Tichavsky, Muravchik, Nehorai,
    IEEE TSP 46(5), 1998). initial_covariance: (r, s, s). truth: (r, K, 6). positions: (r, n, K, 3). measured:
    (r, n, K). age: (r, n, K), s.
    """
    runs, agents, steps = measured.shape
    bound = np.empty((steps, runs, 6, 6))
    covariance = initial_covariance
    # What ranges tell depends on the truth alone, so that of many steps is computed at once.
    at_once = max(1, _ROWS // (runs * agents))
    for since in range(0, steps, at_once):
        part = slice(since, since + at_once)
        heard = np.moveaxis(measured[:, :, part], 2, 0), np.moveaxis(age[:, :, part], 2, 0)
        along, places = np.moveaxis(truth[:, part, space.kept], 1, 0), np.moveaxis(positions[:, :, part], 2, 0)
        ranged = _told(space, along, places, *heard) / range_std**2
        for k, information in enumerate(ranged, since):
            covariance = inverse(inverse(motion.predict_covariance(covariance)) + information)
            bound[k] = space.embed_covariance(covariance)
    return np.moveaxis(bound, 0, 1)


def _told(space: Space, truth: Floats, positions: Floats, measured: Bools, age: Floats) -> Floats:
    """What ranges of noise 1 tell of a truth in K steps of r runs: information matrices (K, r, s, s)."""
    steps, runs, agents = measured.shape
    state = np.repeat(truth.reshape(steps * runs, -1), agents, axis=0)
    _, rows = own_range(space, state, positions.reshape(-1, 3), np.nan_to_num(age).ravel())
    rows = np.where(measured[..., None], rows.reshape(steps, runs, agents, -1), 0.0)
    return np.asarray(np.swapaxes(rows, 2, 3) @ rows)
