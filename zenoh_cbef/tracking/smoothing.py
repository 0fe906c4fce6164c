"""Smoothing: what later estimates say of earlier steps. Each agent smooths its own, and needs no message for it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.backwards import Backward, Backwards, OneMotion
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.motion import LinearMotion
from zenoh_cbef.tracking.ranging import Space


@dataclass(frozen=True)
class Smoothed:
    """Estimates of a step, (n, 6) and (n, 6, 6), from those up to a later one; they mean something in `known` rows."""

    step: int
    until: int
    state: Floats
    covariance: Floats
    known: Bools


class FixedLag:
    """The smoothed estimates of `lag` steps ago, step after step; what is left at the end has a shorter lag.

    A lag as long as the run gives the fixed-interval smoother of Rauch, Tung and Striebel. The filter's estimates are
    taken as they are: the smoother does not ask where they came from. So where a network widens its covariance, finds
    the target again or gets a first fix, the later estimate is carried back by as much as the earlier one was unsure
    by its own covariance.
    """

    def __init__(self, backwards: Backwards, space: Space, lag: int) -> None:
        self.lag = lag
        self._backwards, self._space = backwards, space
        self._window: deque[Backward] = deque(maxlen=lag)
        self._latest: Belief | None = None
        self._step = 0
        self._age = np.zeros(0, dtype=np.int64)
        self._excess: deque[Floats | None] = deque(maxlen=lag + 1)

    def take(self, step: int, belief: Belief, new: Bools | None = None) -> None:
        """Take in the filter's belief of the next step; new: agents (n,) that begin with it."""
        latest = self._backwards.kept(belief)
        if self._latest is None:
            self._age = np.full(len(belief.state), -1)
        else:
            self._window.append(self._backwards.between(self._latest, latest))
        self._latest = latest
        self._excess.append(belief.excess)
        self._step, self._age = step, self._age + 1
        if new is not None:
            self._age[new] = 0

    def due(self, *, last: bool = False) -> list[Smoothed]:
        """The estimates of `lag` steps ago, where there are any; at the last step also those of all steps since."""
        rest = self.rest() if last else []
        if self._latest is None or len(self._window) < self.lag:
            return rest
        *_, oldest = self._carried()
        return [self._told(self.lag, *oldest), *rest]

    def rest(self) -> list[Smoothed]:
        """At the end: the estimates of the steps that were not due yet, the earliest first."""
        return [one for one in self.back() if one.step > self._step - self.lag][::-1]

    def back(self) -> Iterator[Smoothed]:
        """The estimates of the latest step, of the one before, and so on, as far back as is kept."""
        return (self._told(before, *one) for before, one in enumerate(self._carried()))

    def _carried(self) -> Iterator[tuple[Floats, Floats]]:
        if self._latest is None:
            return
        state, covariance = self._latest.state, self._latest.known_covariance
        yield state, covariance
        for backward in reversed(self._window):
            state, covariance = backward.carried(state, covariance)
            yield state, covariance

    def _told(self, before: int, state: Floats, covariance: Floats) -> Smoothed:
        if (excess := self._excess[-1 - before]) is not None:
            covariance = covariance * (1.0 + excess)[:, None, None]
        finite = np.asarray(np.isfinite(state).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2)))
        return Smoothed(
            self._step - before,
            self._step,
            self._space.embed_state(state),
            self._space.embed_covariance(covariance),
            (self._age >= before) & finite,
        )


def smoothed(
    states: Floats,
    covariances: Floats,
    motion: LinearMotion,
    space: Space,
    lag: int | None = None,
    *,
    excess: Floats | None = None,
) -> tuple[Floats, Floats]:
    """Smooth the estimates of K steps, (n, K, 6) and (n, K, 6, 6), by a lag, None for the whole run; NaN for nothing.

    motion: of position and velocity alone, as these are all that a log has. excess: see `Diagnostics`, (n, K).
    Steps without an estimate, between others, are predicted from the one before.
    """
    found, uncertain = np.full_like(states, np.nan), np.full_like(covariances, np.nan)
    steps = states.shape[1]
    window = FixedLag(OneMotion(motion), space, steps if lag is None else min(lag, steps))
    wider = np.zeros(states.shape[:2]) if excess is None else np.nan_to_num(excess)
    for step, belief in enumerate(_without_gaps(states, covariances, motion, space), 1):
        wide = wider[:, step - 1] if np.count_nonzero(wider) else None
        window.take(step, replace(belief, excess=wide))
        for one in window.due(last=step == steps):
            found[one.known, one.step - 1] = one.state[one.known]
            uncertain[one.known, one.step - 1] = one.covariance[one.known]
    known = np.asarray(np.isfinite(states).all(axis=2))
    between = np.logical_or.accumulate(known, axis=1) & np.logical_or.accumulate(known[:, ::-1], axis=1)[:, ::-1]
    found[~between] = uncertain[~between] = np.nan
    return found, uncertain


def _without_gaps(states: Floats, covariances: Floats, motion: LinearMotion, space: Space) -> Iterator[Belief]:
    """Each step's estimates, predicted where there are none; before an agent's first one they mean nothing."""
    kept, count = space.kept, len(states)
    state, covariance = np.zeros((count, motion.size)), np.tile(np.eye(motion.size), (count, 1, 1))
    for k in range(states.shape[1]):
        known = np.asarray(np.isfinite(states[:, k]).all(axis=1))
        spread = motion.predict_covariance(covariance)
        state = np.where(known[:, None], states[:, k, kept], motion.predict_state(state))
        covariance = np.where(known[:, None, None], covariances[:, k, kept[:, None], kept], spread)
        yield Belief(state, covariance)
