"""A centralised tracker of recorded ranges, written apart from the package: a yardstick that shares none of its faults.

Common and own biases are always estimated, errors are Student-t, the velocity decays within ten seconds, and several
starts compete at first and after silences. It takes in one range after the other, each at its own time.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.datasets import Dataset

_DECAY = 10.0
"""Time constant of the velocity, s."""

_FREEDOM, _PASSES = 4.0, 3
"""Degrees of freedom of the errors, and how often a range is linearised."""

_COMMON, _OWN = 1.5, 0.15
"""Standard deviations of the biases that all anchors have and that each has besides, in noises."""

_SILENCE, _CONTEST = 5.0, 5.0
"""After how long without ranges new starts are tried, and for how long they compete, s."""

_GATHERED, _LONGEST = 0.3, 3.0
"""For how long ranges are gathered for new starts, at least, and at most until enough anchors have one, s."""

_TRIALS, _STARTS = 60, 6
_FAST = 3.0
"""Standard deviation of a start's velocity, m/s."""


@dataclass(frozen=True)
class Told:
    """What the tracker knows: a set, its noise, m, the power of accelerations, m^2/s^3, and a plane's height, m."""

    dataset: Dataset
    std: float
    power: float
    height: float | None

    @property
    def axes(self) -> int:
        """How many are estimated."""
        return 3 if self.height is None else 2

    def away(self, place: Floats, anchors: Floats) -> tuple[Floats, Floats]:
        """From anchors (k, 3) to a place (axes,), and the distances (k,), m."""
        across = place - anchors[:, : self.axes]
        up = 0.0 if self.height is None else (self.height - anchors[:, 2]) ** 2
        return across, np.sqrt(np.sum(across**2, axis=1) + up) + 1e-9


@dataclass(frozen=True)
class Hypothesis:
    """State (position, velocity, common bias, own biases), its covariance, and the logarithm of its likelihood."""

    told: Told
    state: Floats
    covariance: Floats
    likelihood: float = 0.0

    @classmethod
    def at(cls, told: Told, place: Floats, biases: Hypothesis | None) -> Self:
        """A start, with the biases of another hypothesis, if there is one."""
        axes = told.axes
        size = 2 * axes + 1 + len(told.dataset.anchors)
        state, covariance = np.zeros(size), np.zeros((size, size))
        if biases is None:
            own = np.full(size - 2 * axes, (_OWN * told.std) ** 2 + 1e-12)
            own[0] = (_COMMON * told.std) ** 2
            covariance[2 * axes :, 2 * axes :] = np.diag(own)
        else:
            state[2 * axes :] = biases.state[2 * axes :]
            covariance[2 * axes :, 2 * axes :] = biases.covariance[2 * axes :, 2 * axes :]
        state[:axes] = place
        spread = np.repeat([10.0 * told.std + 0.5, _FAST], axes)
        covariance[: 2 * axes, : 2 * axes] = np.diag(spread**2)
        return cls(told, state, covariance)

    def predicted(self, seconds: float) -> Self:
        """Some time later."""
        if seconds <= 0.0:
            return self
        axes, rate, power = self.told.axes, 1.0 / _DECAY, self.told.power
        left = np.exp(-rate * seconds)
        place, fast = np.arange(axes), axes + np.arange(axes)
        step = np.eye(len(self.state))
        step[place, fast], step[fast, fast] = (1.0 - left) / rate, left
        covariance = step @ self.covariance @ step.T
        half = (1.0 - left * left) / (2.0 * rate)
        covariance[place, place] += power / rate**2 * (seconds - 2.0 * (1.0 - left) / rate + half)
        covariance[place, fast] += power / rate * ((1.0 - left) / rate - half)
        covariance[fast, place] = covariance[place, fast]
        covariance[fast, fast] += power * half
        return replace(self, state=step @ self.state, covariance=covariance)

    def after(self, anchor: int, measured: float) -> Self:
        """With a range of an anchor, m."""
        axes, prior, noise = self.told.axes, self.state, self.told.std**2
        state, row = prior, np.zeros(len(prior))
        row[[2 * axes, 2 * axes + 1 + anchor]] = 1.0
        for _ in range(_PASSES):
            across, distance = self.told.away(state[:axes], self.told.dataset.anchors[anchor, None])
            row[:axes] = across[0] / distance[0]
            left = measured - (distance[0] + row[2 * axes :] @ state[2 * axes :] + row @ (prior - state))
            known = self.covariance @ row
            variance = row @ known + noise
            weight = max(1.0, (_FREEDOM + left**2 / variance) / (_FREEDOM + 1.0))
            gain = known / (row @ known + weight * noise)
            state = prior + gain * left
        covariance = self.covariance - np.outer(gain, known)
        tail = (_FREEDOM + 1.0) / 2.0 * np.log1p(left**2 / variance / _FREEDOM)
        likelihood = self.likelihood - 0.5 * np.log(variance) - tail
        return replace(self, state=state, covariance=0.5 * (covariance + covariance.T), likelihood=float(likelihood))


@dataclass
class _Tracker:
    """All hypotheses at the time of the latest range, and a search that gathers ranges."""

    told: Told
    kept: list[Hypothesis] = field(default_factory=list)
    gathered: list[int] = field(default_factory=list)
    searching: bool = True
    until: float = -np.inf

    def hear(self, row: int) -> None:
        """Take in the range of a row of the set."""
        data = self.told.dataset
        now, before = data.range_time[row], data.range_time[max(row - 1, 0)]
        self.kept = [each.predicted(now - before) for each in self.kept]
        if now - before > _SILENCE:
            self.kept = [replace(self.best, likelihood=0.0)] if self.kept else []
            self.searching, self.gathered = True, []
        self.kept = [self._with(each, row) for each in self.kept]
        if self.searching:
            self.gathered.append(row)
            self._seek(float(now))
        elif len(self.kept) > 1 and now > self.until:
            self.kept = [self.best]

    @property
    def best(self) -> Hypothesis:
        """The likeliest."""
        return max(self.kept, key=lambda each: each.likelihood)

    def _with(self, one: Hypothesis, row: int) -> Hypothesis:
        return one.after(int(self.told.dataset.range_anchor[row]), float(self.told.dataset.ranges[row]))

    def _seek(self, now: float) -> None:
        data, rows = self.told.dataset, self.gathered
        span = now - data.range_time[rows[0]]
        several = len({*data.range_anchor[rows].tolist()}) > self.told.axes
        if span < _GATHERED or (not several and span < _LONGEST):
            return
        for place in starts(self.told, rows):
            one = Hypothesis.at(self.told, place, self.kept[0] if self.kept else None)
            for before, row in zip([rows[0], *rows], rows, strict=False):
                one = self._with(one.predicted(data.range_time[row] - data.range_time[before]), row)
            self.kept.append(one)
        self.searching, self.until = False, now + _CONTEST


def starts(told: Told, rows: list[int]) -> list[Floats]:
    """The best places of several descents, each from somewhere else, to the latest ranges of some rows."""
    data, random = told.dataset, np.random.default_rng(rows[0])
    latest = {int(data.range_anchor[row]): float(data.ranges[row]) for row in rows}
    anchors, ranges = data.anchors[[*latest]], np.array([*latest.values()])
    middle = data.anchors.mean(axis=0)[: told.axes]
    wide = float(np.ptp(data.anchors, axis=0)[: told.axes].max()) + 1.0
    found = []
    for _ in range(_TRIALS):
        place = middle + random.uniform(-1.2, 1.2, told.axes) * max(wide, float(np.median(ranges)))
        for trial in range(25):
            across, distance = told.away(place, anchors)
            left, rows_ = ranges - distance, across / distance[:, None]
            unit = wide if trial < 10 else 3.0 * told.std + 0.02 * wide
            weight = 1.0 / (1.0 + (left / unit) ** 2)
            normal = (rows_ * weight[:, None]).T @ rows_ + 1e-3 * np.eye(told.axes)
            place = place + np.linalg.solve(normal, (rows_ * weight[:, None]).T @ left)
        cost = float(np.log1p(((ranges - told.away(place, anchors)[1]) / (3.0 * told.std)) ** 2).sum())
        found.append((cost, place))
    kept = list[Floats]()
    for _, place in sorted(found, key=lambda each: each[0]):
        if len(kept) < _STARTS and all(np.linalg.norm(place - other) > 0.05 * wide for other in kept):
            kept.append(place)
    return kept


def track(told: Told, at: Floats) -> Floats:
    """Positions (k, axes) at some times, s, in order, each from the ranges before it; NaN before a first start."""
    tracker, found = _Tracker(told), np.full((len(at), told.axes), np.nan)
    times = told.dataset.range_time
    heard = np.searchsorted(times, at, side="right")
    done = 0
    for place, (moment, many) in enumerate(zip(at.tolist(), heard.tolist(), strict=True)):
        for row in range(done, many):
            tracker.hear(row)
        done = max(done, many)
        if tracker.kept:
            found[place] = tracker.best.predicted(moment - times[done - 1]).state[: told.axes]
    return found
