"""An agent's counts of its neighbours' messages, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ints
from zenoh_cbef.faults.injected import FATES
from zenoh_cbef.log.read.columns import Columns
from zenoh_cbef.log.read.tables import Table

COUNTS = ("received", "lost", "late")
INJECTED = ("injected_lost", "injected_late", "corrupted", "duplicated")
_PASSED = (*COUNTS, "latency")


@dataclass(frozen=True)
class Receipt:
    """What an agent's estimate says of its neighbours' messages, for the neighbours in order.

    counts: since the start, by field. marks: of the step, a text for each; None where faults touched no message of it.
    """

    neighbours: list[int]
    counts: dict[str, list[int]]
    marks: list[str] | None


class Receipts:
    """One agent's counts by step; d neighbours, in the order in which the agent named them first.

    Of an estimate that names others, or has another number of counts than neighbours, nothing is kept.
    """

    def __init__(self, limit: int) -> None:
        self.neighbours: list[int] = []
        self._limit = limit
        self._table = self._of(0)
        self._fates: dict[int, list[str]] = {}

    def put(self, step: Ints, messages: Columns, new: Bools) -> None:
        """Keep what some estimates (m,) say of their steps (m,), those that are the first of theirs: new, (m,)."""
        self._know(messages, new)
        width = len(self.neighbours)
        fits = new & (messages.numbers("neighbours", width) == self.neighbours).all(axis=1)
        for name in ("neighbours", *_PASSED):
            fits &= messages.sizes(name) == width
        for name in (*INJECTED, FATES):
            fits &= ~messages.has(name) | (messages.sizes(name) == width)
        if not fits.any():
            return
        numbers = {name: messages.numbers(name, width)[fits] for name in INJECTED if name in messages.names}
        numbers["passed"] = np.concatenate([messages.numbers(name, width)[fits] for name in _PASSED], axis=1)
        self._table.put(0, step[fits], None, seq=messages.numbers("seq")[fits], **numbers)
        if FATES in messages.names:
            told = zip(step.tolist(), messages.texts(FATES), fits.tolist(), strict=True)
            self._fates |= {k: marks for k, marks, fit in told if fit and marks is not None}

    def _know(self, messages: Columns, new: Bools) -> None:
        """Learn the ids of the neighbours."""
        sizes = messages.sizes("neighbours")
        naming = np.flatnonzero(new & (sizes > 0)).tolist()
        if naming and not self.neighbours:
            named = messages.numbers("neighbours", int(sizes[naming[0]]))[naming[0]]
            self.neighbours = named.astype(np.int64).tolist()
            self._table = self._of(len(named))

    def _of(self, width: int) -> Table:
        return Table(1, self._limit, seq=1, passed=len(_PASSED) * width, **dict.fromkeys(INJECTED, width))

    def _numbers_of(self, name: str, until: int) -> Floats:
        """What it told in each step up to `until`, (until, d), NaN where it said nothing."""
        if name not in _PASSED:
            return np.asarray(self._table.numbers(name, until)[0])
        return self._passed(until)[:, _PASSED.index(name)]

    def _passed(self, until: int) -> Floats:
        """The counts since the start and the latency of each step up to `until`, (until, 4, d)."""
        told = self._table.numbers("passed", until)[0]
        return np.asarray(told.reshape(len(told), len(_PASSED), len(self.neighbours)))

    def steps(self, until: int) -> Ints:
        """The steps up to `until` of which the agent said something, (m,), ascending."""
        return np.asarray(np.flatnonzero(self._table.seen(until)[0]) + 1)

    def counts(self, name: str, until: int) -> Floats:
        """What it counted, or a latency in s, in these steps, (m, d); NaN where it said nothing."""
        return np.asarray(self._numbers_of(name, until)[self.steps(until) - 1])

    def begun(self, until: int) -> Bools:
        """In which of these steps the agent counts anew, (m,): it was started again, and numbers from 0."""
        return np.asarray(np.diff(self.counts("seq", until)[:, 0], prepend=-1.0) <= 0.0)

    def fresh(self, since: int, until: int) -> tuple[Ints, Floats]:
        """What the agent counted in steps since+1 to until, each by itself: those steps (m,), (m, 4, d).

        The four: how many messages came in time, were lost and came late in the step, and their latency in it, s. A
        step without an estimate is left out.
        """
        seen = self._table.seen(until)[0]
        chosen = since + np.flatnonzero(seen[since:])
        # Counts are since the start: a step's own are what they grew by since the one before.
        told_before = since and seen[since - 1]
        former = np.array([since - 1]) if told_before else np.flatnonzero(seen[:since])[-1:]
        rows = np.concatenate([former, chosen])
        told = self._passed(until)[rows]
        seq = self._table.numbers("seq", until)[0, rows, 0]
        again = seq[1:] <= seq[:-1]
        told[1:, : len(COUNTS)] -= np.where(again[:, None, None], 0.0, told[:-1, : len(COUNTS)])
        return chosen + 1, told[len(former) :]

    def marks(self, step: int) -> list[str] | None:
        """What faults did to the messages of a step, a text for each neighbour; None where they touched none."""
        return self._fates.get(step)

    def known(self, step: int) -> bool:
        """Whether the agent said something of a step that fits."""
        return step >= 1 and bool(self._table.seen(step)[0, step - 1])

    def told(self, step: int) -> Receipt | None:
        """What its estimate of a step says; None where that is not known."""
        if not self.known(step):
            return None
        rows = {name: self._numbers_of(name, step)[step - 1] for name in (*COUNTS, *INJECTED)}
        counts = {name: row.astype(np.int64).tolist() for name, row in rows.items() if not np.isnan(row).any()}
        return Receipt(self.neighbours, counts, self._fates.get(step))
