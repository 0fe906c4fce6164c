"""The yardsticks, offline: the centralised filter that sees every range at once, and the posterior bound."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.information_form import saturation
from zenoh_cbef.tracking.linalg import inverse, matvec
from zenoh_cbef.tracking.motion import LinearMotion, Motion
from zenoh_cbef.tracking.ranging import Space, own_range

Floats = NDArray[np.float64]


def centralized_step(
    belief: Belief,
    motion: Motion,
    space: Space,
    *,
    positions: Floats,
    ranges: Floats,
    age: Floats,
    range_std: float,
    xi: float,
    power: int = 1,
) -> Belief:
    """One step of the extended information filter on all agents' ranges, for r runs at once.

    belief: (r, s), (r, s, s). positions: (r, n, 3), m. ranges, age: (r, n), m and s; NaN ranges are left out.
    Each range is saturated at xi of its own standard deviations, as in sicf; infinite xi turns that off. power:
    of the saturation.
    """
    runs, agents = ranges.shape
    state = motion.predict_state(belief.state)
    covariance = motion.predict_covariance(belief.known_covariance, belief.state)
    predicted, rows = own_range(
        space, np.repeat(state, agents, axis=0), positions.reshape(-1, 3), np.nan_to_num(age).ravel()
    )
    rows = rows.reshape(runs, agents, -1)
    measured = np.isfinite(ranges)
    innovation = np.where(measured, ranges - predicted.reshape(runs, agents), 0.0)
    spread = np.sqrt(np.sum(rows * (rows @ covariance), axis=2) + range_std**2)
    precision = np.where(measured, saturation(innovation, xi * spread, power), 0.0) / range_std**2
    weighted = precision[:, :, None] * rows
    information = inverse(covariance) + np.swapaxes(weighted, 1, 2) @ rows
    updated = inverse(information)
    return Belief(state + matvec(updated, np.sum(weighted * innovation[:, :, None], axis=1)), updated)


def centralized_beliefs(
    initial: Belief,
    motion: Motion,
    space: Space,
    *,
    positions: Floats,
    ranges: Floats,
    age: Floats,
    range_std: float,
    xi: float,
    power: int = 1,
) -> Iterator[Belief]:
    """The centralised filter's beliefs of K steps, for r runs.

    initial: (r, s), (r, s, s). positions: (r, n, K, 3). ranges, age: (r, n, K).
    """
    belief = initial
    for k in range(ranges.shape[2]):
        belief = centralized_step(
            belief,
            motion,
            space,
            positions=positions[:, :, k],
            ranges=ranges[:, :, k],
            age=age[:, :, k],
            range_std=range_std,
            xi=xi,
            power=power,
        )
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
    measured: NDArray[np.bool_],
    age: Floats,
    range_std: float,
) -> Floats:
    """Posterior Cramer-Rao bound along a known truth, (r, K, 6, 6): no unbiased tracker's covariance is smaller.

    J(k+1) = (Q + A J(k)^-1 A^T)^-1 + sum_i H_i^T H_i / sigma^2, H_i at the truth (Tichavsky, Muravchik, Nehorai,
    IEEE TSP 46(5), 1998). initial_covariance: (r, s, s). truth: (r, K, 6). positions: (r, n, K, 3). measured:
    (r, n, K). age: (r, n, K), s.
    """
    runs, agents, steps = measured.shape
    bound = np.empty((runs, steps, 6, 6))
    covariance = initial_covariance
    for k in range(steps):
        state = np.repeat(truth[:, k, space.kept], agents, axis=0)
        ages = np.nan_to_num(age[:, :, k]).ravel()
        _, rows = own_range(space, state, positions[:, :, k].reshape(-1, 3), ages)
        rows = np.where(measured[:, :, k, None], rows.reshape(runs, agents, -1), 0.0)
        information = np.swapaxes(rows, 1, 2) @ rows / range_std**2
        covariance = inverse(inverse(motion.predict_covariance(covariance)) + information)
        bound[:, k] = space.embed_covariance(covariance)
    return bound
