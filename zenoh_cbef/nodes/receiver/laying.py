"""Ranges laid onto steps by the times that the source tells, in realtime and in lockstep."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np

from zenoh_cbef.datasets.sharing import Shares, hair, step_of
from zenoh_cbef.nodes.receiver.ranged import Ranged
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.paths import step_times

_OLDEST = 3.0
"""Steps before the end of a step from which a range that came late is still of use."""
_WINDOW = 30.0
"""How long the quickest message is taken to have needed no time, s: clocks drift apart by less than that matters."""


class Laid(NamedTuple):
    """A range in its step: when it was measured, s since step 0, and m."""

    emitted: float
    distance: float


class Offset:
    """By how much this host's clock is ahead of a source's, s: the least that any message of the last seconds shows.

    Each message shows the difference and the time that it was on its way, or waited to be read.
    """

    def __init__(self) -> None:
        self._least, self._before, self._since = inf, inf, -inf

    def of(self, time: float, now: float) -> float:
        """The offset after one more message, of a source's time, came at a time of this host."""
        if now - self._since > _WINDOW:
            self._before, self._least, self._since = self._least, inf, now
        self._least = min(self._least, now - time)
        return min(self._least, self._before)


class Latest:
    """Realtime: each step takes each anchor's latest range that was measured by its end, and not long before.

    dt: s. start: time of step 0 on this host's clock, s since 1970.
    """

    def __init__(self, agents: int, dt: float) -> None:
        self._dt, self._ranges = dt, [list[tuple[float, float]]() for _ in range(agents)]

    def add(self, agent: int, moment: float, distance: float) -> None:
        """A range, measured at a moment of this host's clock, s since 1970."""
        self._ranges[agent].append((moment, distance))

    def take(self, step: int, start: float) -> list[Laid | None]:
        """What each agent gets in a step; start: when step 0 was, s since 1970."""
        end, found = start + step * self._dt, list[Laid | None]()
        for ranges in self._ranges:
            due = [one for one in ranges if end - _OLDEST * self._dt < one[0] <= end]
            ranges[:] = [one for one in ranges if one[0] > end]
            moment, distance = max(due, default=(0.0, 0.0))
            found.append(Laid(moment - start, distance) if due else None)
        return found


@dataclass
class InStep:
    """Lockstep: each step takes what a dataset of these ranges would give it, so the run is that of the dataset.

    A step is open until a range of a later one has come, or the source is over, or silent. late: ranges of steps that
    were closed by then.
    """

    scenario: Scenario

    def __post_init__(self) -> None:
        self._length, self._origin = self.scenario.length, self.scenario.target.origin
        self._run = step_times(self.scenario, self._length)
        self._shares = [Shares[Ranged](self._length) for _ in range(self.scenario.count)]
        self._shared: list[list[list[Ranged]]] = [[] for _ in self._shares]
        self._last, self._complete, self._given = -1, 0, 0
        self.late = 0

    def add(self, agent: int, time: float, one: Ranged) -> None:
        """A range, measured at a time on the source's clock, s. Times of a source ascend."""
        if self._origin is None:
            self._origin = time - self.scenario.dt
        step = int(step_of(self._origin + self._run, time, hair(time)))
        self._last = max(self._last, step)
        if step < self._complete:
            self.late += 1
        elif step < self._length:
            self._shares[agent].add(step, one)
        self._complete = max(self._complete, min(step, self._length))

    def close(self, *, all_: bool) -> None:
        """No more ranges of the last step that has any will come; all_: nor of any other."""
        self._complete = self._length if all_ else max(self._complete, min(self._last + 1, self._length))

    def take(self) -> list[Laid | None] | None:
        """What each agent gets in the next step; None while the step is open."""
        for shares, shared in zip(self._shares, self._shared, strict=True):
            while len(shared) <= self._given and (found := shares.take(self._complete)) is not None:
                shared.append(found)
        if any(len(shared) <= self._given for shared in self._shared):
            return None
        here = [shared[self._given] for shared in self._shared]
        self._given += 1
        origin = self._origin or 0.0
        return [_mean(each, origin) if each else None for each in here]


def _mean(ranges: list[Ranged], origin: float) -> Laid:
    times = np.array([one.time for one in ranges], dtype=np.float64)
    return Laid(float(times.mean() - origin), float(np.array([one.distance for one in ranges]).mean()))
