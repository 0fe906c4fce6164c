"""Keeps estimates finite, whatever messages contain."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.tracking.filters.base import Belief, Bias
from zenoh_cbef.tracking.ranging import Measurement

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

LARGEST = 1e100
"""Beyond it squares of squares are no longer finite; in no unit is a place or a speed that large."""

LARGEST_SENT = 1e60
"""No number of a payload is larger. None that is honest comes near: a scenario's ranges allow an information of 1e18
per range (a spread of 1 nm), of 1e3 agents in 1e7 steps, times 1e12 for velocities (the square of the longest dt), and
a position of 1e15 m: 1e55 in all. And its fourth power is finite, so that an update can be computed from it.
"""

_MODEST = 0.9 * LARGEST_SENT**2
"""Where the sum of all squares is no larger, rounded as it is, no number is beyond `LARGEST_SENT`."""


def bounded(payload: Floats) -> Floats:
    """Payloads (n, d) with no number beyond `LARGEST_SENT`: only what liars have said gets there."""
    return payload if is_bounded(payload) else np.clip(payload, -LARGEST_SENT, LARGEST_SENT)


def is_bounded(payload: Floats) -> bool:
    """Whether no number is beyond `LARGEST_SENT`, and none is NaN."""
    if np.vdot(payload, payload) <= _MODEST:  # One cheap call: this is asked of every message.
        return True
    return bool(np.maximum.reduce(np.abs(payload), axis=None, initial=0.0) <= LARGEST_SENT)


def immoderate(values: Floats) -> Bools:
    """Which rows of an array (n, ...) hold a number that is not finite, or above the limit: (n,)."""
    size = np.abs(values)
    if size.max(initial=0.0) <= LARGEST:
        return np.zeros(len(values), dtype=bool)
    return np.asarray(~(size.reshape(len(values), -1) <= LARGEST).all(axis=1))


def immoderate_belief(belief: Belief) -> Bools:
    """Which agents' (n,) state or covariance is immoderate, also in a part of the belief."""
    found = immoderate(belief.state)
    if belief.covariance is not None:
        found = found | immoderate(belief.covariance)
    for part in belief.parts:
        found = found | immoderate_belief(part)
    return found


def unheard(measurement: Measurement) -> Measurement:
    """The update of the same step as if nothing had been measured or heard."""
    return replace(
        measurement,
        range=np.full_like(measurement.range, np.nan),
        age=np.zeros_like(measurement.age),
        neighbour_position=np.zeros_like(measurement.neighbour_position),
        neighbour_range=np.full_like(measurement.neighbour_range, np.nan),
    )


def chosen(old: Belief, new: Belief, rows: Bools) -> Belief:
    """A belief with some rows (n,) taken from another one of the same filter and step."""

    def pick(first: Floats, second: Floats) -> Floats:
        return np.where(rows.reshape(-1, *(1,) * (first.ndim - 1)), second, first)

    def pick_any(first: Floats | None, second: Floats | None) -> Floats | None:
        return None if first is None or second is None else pick(first, second)

    bias = old.bias
    if bias is not None and new.bias is not None:
        bias = Bias(*(pick(getattr(bias, one.name), getattr(new.bias, one.name)) for one in fields(Bias)))
    return Belief(
        pick(old.state, new.state),
        pick_any(old.covariance, new.covariance),
        bias,
        tuple(pick(*pair) for pair in zip(old.memory, new.memory, strict=True)),
        tuple(chosen(*pair, rows) for pair in zip(old.parts, new.parts, strict=True)),
    )
