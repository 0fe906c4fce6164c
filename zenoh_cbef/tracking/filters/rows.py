"""Beliefs of a batch, put together of some rows of one and some of another."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.filters.base import Belief, Bias
from zenoh_cbef.tracking.status import Status

_Said = TypeVar("_Said", Bias, Status)


def chosen(old: Belief, new: Belief, rows: Bools) -> Belief:
    """A belief with some rows (n,) taken from another one of the same filter and step."""

    def pick(first: Floats, second: Floats) -> Floats:
        return np.where(rows.reshape(-1, *(1,) * (first.ndim - 1)), second, first)

    def pick_any(first: Floats | None, second: Floats | None) -> Floats | None:
        return None if first is None or second is None else pick(first, second)

    def pick_all(first: _Said | None, second: _Said | None) -> _Said | None:
        if first is None or second is None:
            return first
        return type(first)(**{name: pick(values, getattr(second, name)) for name, values in vars(first).items()})

    return Belief(
        pick(old.state, new.state),
        pick_any(old.covariance, new.covariance),
        pick_all(old.bias, new.bias),
        tuple(pick(*pair) for pair in zip(old.memory, new.memory, strict=True)),
        tuple(chosen(*pair, rows) for pair in zip(old.parts, new.parts, strict=True)),
        pick_all(old.status, new.status),
        pick_any(old.chance, new.chance),
    )
