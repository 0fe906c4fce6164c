"""Messages as arrays that grow with the run: nothing else of a message is kept."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_cbef.arrays import Bools, Floats, Ints

_FIRST_CAPACITY = 64
_LATEST = (1 << 63) - 1


class Stamps(NamedTuple):
    """When messages, arrays of one shape, were logged and sent, ns since the epoch."""

    logged: Ints
    sent: Ints

    def chosen(self, which: Bools) -> Stamps:
        """Those of some messages."""
        return Stamps(self.logged[which], self.sent[which])


def stamps_of(logged: NDArray[np.uint64], sent: ArrayLike) -> Stamps:
    """The stamps of some messages (m,). A log time beyond 63 bits, which no clock shows, becomes the latest one."""
    clipped = np.minimum(logged, np.uint64(_LATEST)).astype(np.int64)
    return Stamps(clipped, np.asarray(sent, dtype=np.int64))


def floats(rows: Sequence[object]) -> Floats:
    """Numbers as an array, NaN for nil."""
    return np.array(rows, dtype=np.float64)


class Table:
    """Messages of one kind by row and step: of each place the first that comes.

    rows: how many. limit: the highest step, from 1. widths: how many numbers a message has of each name; those that
    no message has take no room. last: the highest step of any message so far.
    """

    def __init__(self, rows: int, limit: int, **widths: int) -> None:
        self.last = 0
        self._rows, self._limit, self._widths = rows, limit, widths
        self._arrays: dict[str, NDArray[Any]] = {}

    def put(self, row: int | Ints, step: Ints, stamps: Stamps | None = None, **numbers: Floats) -> Bools:
        """Put messages, (m,), each unless one is there already; says which of them were put, (m,).

        row: of all, or of each (m,). numbers: (m, width). A message whose step the table lacks is left out.
        """
        columns = {**(stamps._asdict() if stamps else {}), **numbers}
        rows, place = np.full(len(step), row), step - 1
        new = (step >= 1) & (step <= self._limit)
        highest = int(step[new].max(initial=0))
        seen = self._array("seen", highest)
        each = rows * self._limit + step
        if not (each[1:] > each[:-1]).all():
            first = np.zeros(len(step), dtype=bool)
            first[np.unique(np.where(new, each, -1), return_index=True)[1]] = True
            new &= first
        new[new] = ~seen[rows[new], place[new]]
        if not new.all():
            rows, place, columns = rows[new], place[new], {name: values[new] for name, values in columns.items()}
        seen[rows, place] = True
        for name, values in columns.items():
            self._array(name, highest)[rows, place] = values
        self.last = max(self.last, int(place.max(initial=-1)) + 1)
        return new

    def seen(self, steps: int) -> Bools:
        """Where there are messages, (rows, steps)."""
        return self._upto("seen", steps)

    def stamps(self, steps: int) -> Stamps:
        """Their stamps, (rows, steps); 0 where there is no message."""
        return Stamps(self._upto("logged", steps), self._upto("sent", steps))

    def numbers(self, name: str, steps: int) -> Floats:
        """Their numbers of a name, (rows, steps, width); NaN where there are none."""
        return self._upto(name, steps)

    def _upto(self, name: str, steps: int) -> NDArray[Any]:
        return self._array(name, steps)[:, :steps]

    def _array(self, name: str, steps: int) -> NDArray[Any]:
        """An array with room for so many steps."""
        found = self._arrays.get(name)
        capacity = 0 if found is None else found.shape[1]
        if found is None or steps > capacity:
            room = max(steps, min(max(2 * capacity, _FIRST_CAPACITY), self._limit))
            grown = self._empty(name, room)
            if found is not None:
                grown[:, :capacity] = found
            found = self._arrays[name] = grown
        return found

    def _empty(self, name: str, steps: int) -> NDArray[Any]:
        if name in self._widths:
            return np.full((self._rows, steps, self._widths[name]), np.nan)
        return np.zeros((self._rows, steps), dtype=bool if name == "seen" else np.int64)
