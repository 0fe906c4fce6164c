"""The strong yardstick over a run: hypotheses begin at the start, after a silence, and where ranges surprise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.analysis.strong.bank import Bank
from zenoh_cbef.analysis.strong.models import Models, Turns
from zenoh_cbef.analysis.strong.ranged import Heard
from zenoh_cbef.analysis.strong.starts import Circles, starts
from zenoh_cbef.arrays import Bools, Floats

_INDICES = (1e-3, 3e-2, 1.0, 30.0)
"""Tracking indices, acceleration noise in units of range noise per step squared, of models that are always tried.

Of the largest acceleration that is tried the velocity jumps.
"""

_TURNS = ((1e-3, 0.1), (3e-2, 1.0))
"""Tracking indices of turns, and by what share of its standard deviation their rate changes in a second."""

_CHALLENGERS = 4
_PASSES_AT_FIRST, _PASSES = 6, 2
_SURPRISED = 3.0
"""Mean squared innovation in its own standard deviations from which on new starts are tried; 1 is usual."""

_MEMORY = 0.1
_CROSSED_IN = 5.0
"""Seconds in which a target that is looked for may cross the agents' box: the least standard deviation of its speed."""


@dataclass(frozen=True)
class Known:
    """What the yardstick is told of r runs.

    dt: s. range_std: m. accelerations: noises that the motion may have, m/s^2. heavy: degrees of freedom of the range
    noise, infinite where outliers are taken out. settle: steps in which a network finds its target. height: of the
    plane, m, None for three axes. mean: (r, s), covariance: (s, s), of the start. bias: (n, n), covariance of the
    biases, None without any. turn_rate_std: rad/s, of a target that may turn; None for one that only goes straight on.
    """

    dt: float
    range_std: float
    accelerations: tuple[float, ...]
    heavy: float
    settle: int
    height: float | None
    mean: Floats
    covariance: Floats
    bias: Floats | None
    turn_rate_std: float | None = None


@dataclass(frozen=True)
class Seen:
    """What agents measured in K steps: positions (r, n, K, 3), ranges and ages (r, n, K), NaN where there are none."""

    positions: Floats
    ranges: Floats
    age: Floats


def strong(known: Known, seen: Seen) -> tuple[Floats, Floats]:
    """States (r, K, s) and covariances (r, K, s, s) along the estimated axes."""
    runs, _, steps = seen.ranges.shape
    size = known.covariance.shape[0]
    states, covariances = np.empty((runs, steps, size)), np.empty((runs, steps, size, size))
    search = _Search(known, seen)
    with np.errstate(all="ignore"):
        for k in range(steps):
            mean, covariance = search.step(k)
            states[:, k], covariances[:, k] = mean[:, :size], covariance[:, :size, :size]
    return states, covariances


class _Search:
    """The hypotheses of a run, and when new ones are needed."""

    def __init__(self, known: Known, seen: Seen) -> None:
        self._known, self._seen = known, seen
        runs, agents, _ = seen.ranges.shape
        self._axes = known.covariance.shape[0] // 2
        unit, rate = known.range_std / known.dt**2, known.turn_rate_std
        noises = np.array(sorted({*known.accelerations, *(unit * index for index in _INDICES)}))
        turns = () if rate is None else tuple(Turns(unit * index, rate, share * rate) for index, share in _TURNS)
        extra = 0 if known.bias is None else agents
        self._models = Models.of(known.dt, noises, self._axes, extra, turns, jumping=True)
        spread = self._spread(known.covariance)
        mean = np.concatenate([known.mean, np.zeros((runs, len(spread) - known.mean.shape[1]))], axis=1)
        spread = np.broadcast_to(spread, (runs, *spread.shape))
        self._bank = Bank.of(mean[:, None], spread[:, None], self._models.transition.shape[0])
        self._until = 0
        self._odd, self._silent = np.ones(runs), np.full(runs, known.settle)
        self._free = np.zeros(runs, dtype=int)

    def _spread(self, covariance: Floats) -> Floats:
        """Of a whole state, from that of position and velocity, (..., s, s)."""
        bias, rate = self._known.bias, self._known.turn_rate_std
        size, biases = covariance.shape[-1], 0 if bias is None else len(bias)
        more = biases + (rate is not None)
        whole = np.zeros((*covariance.shape[:-2], size + more, size + more))
        whole[..., :size, :size] = covariance
        if bias is not None:
            whole[..., size : size + biases, size : size + biases] = bias
        if rate is not None:
            whole[..., -1, -1] = rate**2
        return whole

    def step(self, k: int) -> tuple[Floats, Floats]:
        """The estimate after step k + 1."""
        heard = self._heard(k, k + 1)
        number = np.isfinite(heard.range).sum(axis=1)
        if k == self._until and self._bank.weight.shape[1] > 1:
            self._bank = self._bank.best()
        lost = (number > 0) & (k >= self._free) & ((self._odd > _SURPRISED) | (self._silent >= self._known.settle))
        if k >= self._until and lost.any():
            self._seek(k, lost)
        passes = _PASSES_AT_FIRST if k < self._until else _PASSES
        passes += 2 * bool(np.isfinite(self._known.heavy))
        self._bank = self._bank.step(self._models, heard, passes)
        fresh = self._bank.surprise / np.maximum(number, 1)
        self._odd = np.where(number > 0, self._odd + _MEMORY * (fresh - self._odd), self._odd)
        self._silent = np.where(number > 0, 0, self._silent + 1)
        return self._bank.estimate()

    def _seek(self, k: int, lost: Bools) -> None:
        """Let new starts compete for a while in these runs, where the first ranges from now on lead."""
        known, heard = self._known, self._heard(k, k + self._known.settle)
        place, wide = starts(Circles(heard.anchor, heard.off, heard.range, known.range_std), _CHALLENGERS)
        runs, size, axes = len(place), self._bank.mean.shape[4], self._axes
        box = np.linalg.norm(np.ptp(heard.anchor, axis=1), axis=1)
        fast = np.maximum(3.0 * np.sqrt(known.covariance[axes, axes]), box / _CROSSED_IN)
        speed = np.linalg.norm(known.mean[:, axes:], axis=1)
        begin = np.zeros((runs, _CHALLENGERS, size))
        begin[..., :axes] = place
        variances = np.repeat(np.stack([wide, fast + speed], axis=1) ** 2, axes, axis=1)
        spread = self._spread(variances[:, None, :, None] * np.eye(2 * axes))
        others = Bank.of(begin, np.tile(spread, (1, _CHALLENGERS, 1, 1)), self._bank.mode.shape[3])
        self._bank = self._bank.joined(others, lost)
        self._until = k + known.settle
        self._free = np.where(lost, k + 5 * known.settle, self._free)
        self._odd = np.where(lost, 1.0, self._odd)

    def _heard(self, first: int, after: int) -> Heard:
        """The first range of each agent in these steps."""
        seen, known, axes = self._seen, self._known, self._axes
        ranges = seen.ranges[:, :, first:after]
        which = np.isfinite(ranges).argmax(axis=2)[:, :, None]
        picked = np.take_along_axis(ranges, which, axis=2)[..., 0]
        age = np.take_along_axis(seen.age[:, :, first:after], which, axis=2)[..., 0]
        place = np.take_along_axis(seen.positions[:, :, first:after], which[..., None], axis=2)[:, :, 0]
        off = np.zeros_like(picked) if known.height is None else (place[..., 2] - known.height) ** 2
        return Heard(
            place[..., :axes], off, picked, np.nan_to_num(age), known.range_std**2, known.heavy, known.bias is not None
        )
