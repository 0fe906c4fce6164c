"""Keeps estimates finite, whatever messages contain."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.filters.base import Belief

LARGEST = 1e100
"""Beyond it squares of squares are no longer finite; in no unit is a place or a speed that large."""

LARGEST_SENT = 1e60
"""No number of a payload is larger. None that is honest comes near: a scenario's ranges allow an information of 1e18
per range (a spread of 1 nm), of 1e3 agents in 1e7 steps, times 1e12 for velocities (the square of the longest dt), and
a position of 1e15 m: 1e55 in all. And its fourth power is finite, so that an update can be computed from it.
"""

SURELY_SENT = 0.25 * LARGEST_SENT**2
"""Numbers whose sum of squares is below it are surely below LARGEST_SENT."""

_MANY = 10_000
"""OpenBLAS splits a longer sum of squares among threads, which on a busy machine wait for one another for longer."""


def is_within(limit: float, *arrays: Floats) -> bool:
    """Whether no number is beyond a limit, and none is NaN. Callers keep NumPy from warning of an overflow."""
    for values in arrays:
        if values.size > _MANY:
            within = values.max() <= limit and values.min() >= -limit
        else:
            # The sum of squares is one call, and nearly always far below; beyond, or where it is not finite, each
            # number is looked at.
            flat = values.ravel()
            within = flat.dot(flat) < 0.25 * limit * limit or np.abs(flat).max(initial=0.0) <= limit
        if not within:
            return False
    return True


def immoderate(values: Floats) -> Bools:
    """Which rows of an array (n, ...) hold a number that is not finite, or above the limit: (n,)."""
    return np.asarray(~(np.abs(values).reshape(len(values), -1) <= LARGEST).all(axis=1))


def is_moderate(belief: Belief) -> bool:
    """Whether all numbers of a belief and of its parts are finite and within the limit."""
    # A filter around another one often hands on that one's very arrays: each is looked at once.
    parts, arrays = [belief], dict[int, Floats]()
    for part in parts:
        parts += part.parts
        arrays[id(part.state)] = part.state
        if part.covariance is not None:
            arrays[id(part.covariance)] = part.covariance
    return is_within(LARGEST, *arrays.values())


def immoderate_belief(belief: Belief) -> Bools:
    """Which agents' (n,) state or covariance is immoderate, also in a part of the belief."""
    found = immoderate(belief.state)
    if belief.covariance is not None:
        found = found | immoderate(belief.covariance)
    for part in belief.parts:
        found = found | immoderate_belief(part)
    return found
