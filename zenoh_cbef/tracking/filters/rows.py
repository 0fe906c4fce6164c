"""Beliefs of a batch, put together of some rows of one and some of another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.filters.base import Belief, Bias, Tie
from zenoh_cbef.tracking.status import Status

_Said = TypeVar("_Said", bound=Bias | Status | Tie)

Rows = NDArray[np.intp]


def chosen(old: Belief, new: Belief, rows: Bools) -> Belief:
    """A belief with some rows (n,) taken from another one of the same filter and step."""

    def pick(first: Floats, second: Floats) -> Floats:
        return picked(first, second, rows)

    def pick_any(first: Floats | None, second: Floats | None) -> Floats | None:
        return None if first is None or second is None else pick(first, second)

    def pick_all(first: _Said | None, second: _Said | None) -> _Said | None:
        if first is None or second is None:
            return first
        return type(first)(**{name: pick(values, getattr(second, name)) for name, values in vars(first).items()})

    return Belief(
        state=pick(old.state, new.state),
        covariance=pick_any(old.covariance, new.covariance),
        bias=pick_all(old.bias, new.bias),
        memory=tuple(pick(*pair) for pair in zip(old.memory, new.memory, strict=True)),
        parts=tuple(chosen(*pair, rows) for pair in zip(old.parts, new.parts, strict=True)),
        status=pick_all(old.status, new.status),
        chance=pick_any(old.chance, new.chance),
        excess=pick_any(old.excess, new.excess),
    )


def picked(old: Floats, new: Floats, rows: Bools) -> Floats:
    """An array (n, ...) with some rows (n,) taken from another one."""
    return np.where(rows.reshape(-1, *(1,) * (old.ndim - 1)), new, old)


def some(belief: Belief, rows: Rows) -> Belief:
    """Some rows of a belief, in their order."""
    return _combined([belief], lambda each: each[0][rows])


def together(beliefs: Sequence[Belief], rows: Sequence[Rows]) -> Belief:
    """The belief of a batch, of whose parts each has the beliefs of some rows."""
    back = np.argsort(np.concatenate(list(rows)))
    return _combined(beliefs, lambda each: np.concatenate(list(each))[back])


def _combined(beliefs: Sequence[Belief], how: Callable[[Sequence[Floats]], Floats]) -> Belief:
    """A belief whose arrays are made of those of others, which have the same ones."""

    def all_of(each: Sequence[tuple[Floats, ...]]) -> tuple[Floats, ...]:
        return tuple(map(how, zip(*each, strict=True)))

    def any_of(each: Sequence[Floats | None]) -> Floats | None:
        known = [one for one in each if one is not None]
        return how(known) if known else None

    def said_of(each: Sequence[_Said | None]) -> _Said | None:
        known = [one for one in each if one is not None]
        if not known:
            return None
        return type(known[0])(**{name: how([vars(one)[name] for one in known]) for name in vars(known[0])})

    return Belief(
        state=how([one.state for one in beliefs]),
        covariance=any_of([one.covariance for one in beliefs]),
        bias=said_of([one.bias for one in beliefs]),
        memory=all_of([one.memory for one in beliefs]),
        parts=tuple(_combined(parts, how) for parts in zip(*(one.parts for one in beliefs), strict=True)),
        status=said_of([one.status for one in beliefs]),
        chance=any_of([one.chance for one in beliefs]),
        excess=any_of([one.excess for one in beliefs]),
        tied=said_of([one.tied for one in beliefs]),
    )
