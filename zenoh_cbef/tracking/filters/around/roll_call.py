"""A number for each of few agents in every payload, by which all know of which agents something is true.

    f_i <- f_i/4, and 1 in the own place where it is true          averaged with the payload

Averages weigh agents by what the graph makes of them, so they do not count. Any agent of which a number is above what a
line of n agents makes of the farthest one is there, whatever its weight.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ids

_KEPT = 0.25
"""What an agent keeps of what it knew of the others a step ago: it passes that on to agents that a step's rounds do not
reach.
"""

_FAINT = 0.1
"""Which share of what one end of a line of agents knows of the other end passes for nothing."""


def told(known: Floats, own: Ids, here: Bools | float = 1.0) -> Floats:
    """What agents (n,) tell, (n, m): what they know of all m, less by a step, and what is true of themselves (n,)."""
    said = _KEPT * known
    said[np.arange(len(known)), own] = here
    return said


def known_of(averaged: Floats) -> Floats:
    """What agents know after averaging, (n, m), from 0 to 1."""
    return np.clip(averaged, 0.0, 1.0)


def count(known: Floats, rounds: int) -> Floats:
    """Of how many agents it is true, (n,), as far as each agent knows. rounds: of a step."""
    return np.asarray(np.count_nonzero(known > faintest(known.shape[1], rounds), axis=1), dtype=np.float64)


@cache
def faintest(agents: int, rounds: int) -> float:
    """What an agent knows of one that is cut off is soon below this; of one that is not it is above, on any graph."""
    weights = np.diag(np.full(agents - 1, 1.0 / 3.0), 1)
    weights = weights + weights.T
    weights += np.diag(1.0 - weights.sum(axis=1))
    step, known = np.linalg.matrix_power(weights, rounds), np.ones((agents, agents))
    for _ in range(50):
        known *= _KEPT
        np.fill_diagonal(known, 1.0)
        known = step @ known
    return float(_FAINT * known.min())
