"""An agent's counts of its neighbours' messages, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ints
from zenoh_cbef.faults.injected import FATES
from zenoh_cbef.log.read.tables import Table, floats
from zenoh_cbef.protocol.kinds import EstimateMessage

COUNTS = ("received", "lost", "late")
INJECTED = ("injected_lost", "injected_late", "corrupted", "duplicated")
_LATENCY = "latency"
_ALWAYS = (*COUNTS, _LATENCY)
_FIELDS = (*_ALWAYS, *INJECTED)


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

    def put(self, step: Ints, messages: Sequence[EstimateMessage]) -> None:
        """Keep what some estimates (m,) say, each the first of its step."""
        if not self.neighbours:
            self.neighbours = next((one["neighbours"] for one in messages if one["neighbours"]), [])
            self._table = self._of(len(self.neighbours)) if self.neighbours else self._table
        numbers = self._numbers(messages)
        if numbers is not None:
            self._table.put(0, step, None, **numbers)
            self._fates |= {one["k"]: one[FATES] for one in messages if FATES in one}
        elif len(messages) > 1:
            for place, one in enumerate(messages):
                self.put(step[place : place + 1], [one])

    def _numbers(self, messages: Sequence[EstimateMessage]) -> dict[str, Floats] | None:
        """What estimates (m,) say, (m, d) for each field that any has; None where one of them does not fit."""
        width = len(self.neighbours)
        marks = [one[FATES] for one in messages if FATES in one]
        if any(one["neighbours"] != self.neighbours for one in messages) or any(len(one) != width for one in marks):
            return None
        names = [name for name in _FIELDS if name in _ALWAYS or any(name in one for one in messages)]
        nothing = [None] * width
        try:
            numbers = {name: floats([one.get(name, nothing) for one in messages]) for name in names}
        except ValueError:  # lists of several sizes
            return None
        if any(values.shape != (len(messages), width) for values in numbers.values()):
            return None
        return numbers | {"seq": floats([[one["seq"]] for one in messages])}

    def _of(self, width: int) -> Table:
        return Table(1, self._limit, seq=1, **dict.fromkeys(_FIELDS, width))

    def steps(self, until: int) -> Ints:
        """The steps up to `until` of which the agent said something, (m,), ascending."""
        return np.asarray(np.flatnonzero(self._table.seen(until)[0]) + 1)

    def counts(self, name: str, until: int) -> Floats:
        """What it counted, or a latency in s, in these steps, (m, d); NaN where it said nothing."""
        return np.asarray(self._table.numbers(name, until)[0, self.steps(until) - 1])

    def begun(self, until: int) -> Bools:
        """In which of these steps the agent counts anew, (m,): it was started again, and numbers from 0."""
        return np.asarray(np.diff(self.counts("seq", until)[:, 0], prepend=-1.0) <= 0.0)

    def fresh(self, names: Sequence[str], since: int, until: int) -> tuple[Ints, Floats]:
        """What the agent counted in steps since+1 to until, each by itself: those steps (m,), (names, m, d).

        Counts are those of the step alone; a latency, s, is that of the step. A step without an estimate is left out.
        """
        seen = self._table.seen(until)[0]
        chosen = since + np.flatnonzero(seen[since:])
        # Counts are since the start: a step's own are what they grew by since the one before.
        former = (
            np.flatnonzero(seen[:since])[-1:] if since and not seen[since - 1] else np.arange(max(since - 1, 0), since)
        )
        rows = np.concatenate([former, chosen])
        told = np.stack([self._table.numbers(name, until)[0, rows] for name in names])
        seq = self._table.numbers("seq", until)[0, rows, 0]
        again = seq[1:] <= seq[:-1]
        for name, values in zip(names, told, strict=True):
            if name != _LATENCY:
                values[1:] -= np.where(again[:, None], 0.0, values[:-1])
        return chosen + 1, told[:, len(former) :]

    def known(self, step: int) -> bool:
        """Whether the agent said something of a step that fits."""
        return step >= 1 and bool(self._table.seen(step)[0, step - 1])

    def told(self, step: int) -> Receipt | None:
        """What its estimate of a step says; None where that is not known."""
        if not self.known(step):
            return None
        rows = {name: self._table.numbers(name, step)[0, step - 1] for name in (*COUNTS, *INJECTED)}
        counts = {name: row.astype(np.int64).tolist() for name, row in rows.items() if not np.isnan(row).any()}
        return Receipt(self.neighbours, counts, self._fates.get(step))
