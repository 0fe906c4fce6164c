"""How ranges are laid onto steps: which of them each step gets."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Floats

T = TypeVar("T")


def hair(largest: float) -> float:
    """What times up to this one, s, may differ by and are still the same: since 1970 floats are coarse."""
    return max(1e-9, 4.0 * float(np.spacing(abs(largest))))


def step_of(times: Floats, moment: float | Floats, spare: float) -> NDArray[np.intp]:
    """The first of the steps that end at times (k,), s, which ends at or after a moment; k where none does."""
    return np.asarray(np.searchsorted(times, np.asarray(moment) - spare))


class Shares(Generic[T]):
    """The ranges of one anchor, laid onto `length` steps as they come, in the order of their steps.

    Where several fall into one step, the last of them goes to the following step, if every range then has a step of its
    own: so a step may have to wait until it is known what comes later.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._items: dict[int, list[T]] = {}
        self._waiting: list[T] = []
        self._next = self._probed = 0

    def add(self, step: int, item: T) -> None:
        """One more range, which falls into a step."""
        self._items.setdefault(step, []).append(item)

    def take(self, complete: int) -> list[T] | None:
        """The share of the next step; None while that is open. complete: of all earlier steps all ranges have come."""
        step = self._next
        if step >= min(complete, self._length):
            return None
        here = [*self._waiting, *self._items.get(step, ())]
        room = len(here) > 1 and self._room(step + 1, complete)
        if room is None:
            return None
        self._waiting = [here.pop()] if room else []
        self._items.pop(step, None)
        self._next += 1
        return here

    def _room(self, step: int, complete: int) -> bool | None:
        """Whether a step has room for one more: it is empty, or its own range can move on in turn; None: not known."""
        at = max(step, self._probed)
        while at < min(complete, self._length) and len(self._items.get(at, ())) == 1:
            at += 1
        self._probed = at
        if at >= self._length:
            return False
        return None if at >= complete else not self._items.get(at)


def shared_out(steps: NDArray[np.intp], length: int) -> Iterator[tuple[int, list[int]]]:
    """Which of the ranges that fall into ascending steps (r,) each step gets."""
    shares = Shares[int](length)
    for number, step in enumerate(steps.tolist()):
        shares.add(step, number)
    for step in range(length):
        here = shares.take(length)
        if here:
            yield step, here
