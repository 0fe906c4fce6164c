"""Recorded ranging data: anchors, ranges, and the truth where it is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.datasets.sharing import hair, shared_out, step_of

_VELOCITY_BASE = 0.1
_LARGEST_GAP, _MANY_INTERVALS = 1.0, 10.0
"""The truth is unknown between positions that are further apart than this, s, and than this many usual intervals."""


@dataclass(frozen=True)
class Dataset:
    """Fixed anchors that range one moving target.

    labels: the anchors' ids, (n,). anchors: (n, 3), m. range_time: (r,), s, ascending. range_anchor: (r,), index
    into the anchors. ranges: (r,), m. truth_time: (t,), s, ascending. truth: (t, 3), m; both empty where the truth is
    not known. order: (r,), the place of each range in its source; as they are here where it is None.
    """

    labels: tuple[str, ...]
    anchors: Floats
    range_time: Floats
    range_anchor: NDArray[np.intp]
    ranges: Floats
    truth_time: Floats
    truth: Floats
    order: NDArray[np.intp] | None = None

    @property
    def has_truth(self) -> bool:
        """Whether the target's true position is known at any time."""
        return len(self.truth_time) > 0

    def origin(self, dt: float) -> float:
        """The time of step 0: one step before the first range."""
        return float(self.range_time[0]) - dt

    def steps(self, dt: float) -> int:
        """How many whole steps the ranges fill."""
        return max(1, int(np.floor((self.range_time[-1] - self.origin(dt)) / dt + self._hair / min(dt, 1.0))))

    @property
    def _hair(self) -> float:
        return hair(float(np.abs(self.range_time).max()))

    @property
    def interval(self) -> float | None:
        """The time from one range of an anchor to its next, s, median of all; None where there is none."""
        times = (self.range_time[self.range_anchor == anchor] for anchor in range(len(self.anchors)))
        gaps = np.concatenate([np.empty(0), *map(np.diff, times)])
        median = float(np.median(gaps)) if len(gaps) else 0.0
        return median if median > 0.0 else None

    def knows_truth(self, times: Floats) -> Bools:
        """Whether dataset times (k,) lie between two true positions that are near enough to each other, (k,)."""
        if not self.has_truth:
            return np.zeros(len(times), dtype=bool)
        after = np.clip(np.searchsorted(self.truth_time, times), 1, max(1, len(self.truth_time) - 1))
        gaps = np.append(np.diff(self.truth_time), 0.0)
        largest = max(_LARGEST_GAP, _MANY_INTERVALS * float(np.median(gaps[:-1]))) if len(gaps) > 1 else 0.0
        inside = (times >= self.truth_time[0]) & (times <= self.truth_time[-1])
        return np.asarray(inside & (gaps[after - 1] <= largest))

    def truth_at(self, times: Floats) -> Floats:
        """True states (k, 6) at dataset times (k,), NaN where the truth is not known.

        Velocities are central differences, and one-sided ones at the ends of what is known.
        """
        if not self.has_truth:
            return np.full((len(times), 6), np.nan)
        base = _VELOCITY_BASE

        def position(at: Floats) -> Floats:
            return np.stack([np.interp(at, self.truth_time, self.truth[:, axis]) for axis in range(3)], axis=1)

        earlier, later = (np.where(self.knows_truth(at), at, times) for at in (times - base, times + base))
        span = np.where((earlier < times) & (later > times), 2.0 * base, later - earlier)
        velocity = (position(later) - position(earlier)) / np.where(span > 0.0, span, np.inf)[:, None]
        state = np.concatenate([position(times), velocity], axis=1)
        return np.where((self.knows_truth(times) & (span > 0.0))[:, None], state, np.nan)

    def beacons(self, times: Floats) -> tuple[Floats, Floats]:
        """The ranges laid onto steps that end at dataset times (k,): (emission time, range), both (n, k).

        A range belongs to the first step that ends at or after it. Where an anchor has several in one step, the last
        of them goes to the following step, if every range then has a step of its own. The others become one: the mean
        of their times and ranges, which is exact for a constant velocity. NaN where no range came.
        """
        emitted = np.full((len(self.anchors), len(times)), np.nan)
        ranges = np.full_like(emitted, np.nan)
        steps = step_of(times, self.range_time, self._hair)
        for anchor in range(len(self.anchors)):
            mine = (self.range_anchor == anchor) & (steps < len(times))
            sent, measured = self.range_time[mine], self.ranges[mine]
            for step, chosen in shared_out(steps[mine], len(times)):
                emitted[anchor, step] = sent[chosen].mean()
                ranges[anchor, step] = measured[chosen].mean()
        return emitted, ranges
