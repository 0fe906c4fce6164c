"""Of how many agents an average is, after so many rounds: the fewer, the less it tells of the whole network."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.streams import stream, uniform
from zenoh_cbef.tracking.graph import Neighbours
from zenoh_cbef.tracking.links import Links
from zenoh_cbef.tracking.weights import weight_matrix

_EXACT = 512
"""Agents of a network whose matrix of weights is raised to a power."""

_DRAWS, _AT_ONCE = 32, 4
"""Random signs of each agent of a larger one, and how many of them are averaged together, for memory's sake."""


def effective_sizes(neighbours: Neighbours, weights: Floats, rounds: int) -> Floats:
    """1 / sum_j ((W^L)_ij)^2 for every agent, (n,), from 1 to n (Kish, Survey Sampling, 1965, section 11.7).

    It is the number of independent values whose plain mean varies as little as the agent's average. In large networks
    it is found from averages of random signs, whose mean square is that sum (Hutchinson, Communications in Statistics
    19(2), 1990), to about a quarter.
    """
    count = len(weights)
    if count <= _EXACT:
        mixed = np.linalg.matrix_power(weight_matrix(neighbours, weights), rounds)
        squares = np.add.reduce(mixed**2, axis=1)
    else:
        squares = _of_signs(neighbours, weights, rounds)
    return np.asarray(np.clip(1.0 / squares, 1.0, float(count)))


def _of_signs(neighbours: Neighbours, weights: Floats, rounds: int) -> Floats:
    """The mean square of each agent's average of random signs, (n,)."""
    links, kept = Links(neighbours), 1.0 - weights.sum(axis=1, keepdims=True)
    factors, keys = links.of(weights)[:, None], stream(0, "signs", np.arange(len(weights)))[:, None]
    squares = np.zeros(len(weights))
    for first in range(0, _DRAWS, _AT_ONCE):
        value = np.where(uniform(keys, 0, np.arange(first, first + _AT_ONCE)) < 0.5, -1.0, 1.0)
        for _ in range(rounds):
            value = kept * value + links.summed(factors * value.take(links.source, axis=0))
        squares += np.add.reduce(value**2, axis=1)
    return squares / _DRAWS
