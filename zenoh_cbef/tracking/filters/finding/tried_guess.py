"""The first fix of a network that has a guess: it tries that before it searches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Belief, Filter, Update
from zenoh_cbef.tracking.filters.finding.first_fix import FirstFix
from zenoh_cbef.tracking.filters.finding.remembered_ranges import Rows
from zenoh_cbef.tracking.filters.finding.squared_ranges import Seen
from zenoh_cbef.tracking.filters.information_form import belief_of, pack, packed_size
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import inverse, unpack_upper
from zenoh_cbef.tracking.ranging import Measurement

FITTING = 0.2
"""Mean weight of an agent's ranges from which on they fit: one of five does."""

FEWER = 0.5
"""At the first of the trials, which comes early, so many times fewer agents are enough."""

SURE = 5
"""In how many of the last steps a large correction excuses no range that does not fit."""


def first_fix(settings: FilterSettings, then: Filter, xi: float, payload_size: int) -> FirstFix:
    """The first fix before a filter. xi: saturation level in standard deviations. payload_size: the filter's."""
    tries = settings.tries_guess and np.isfinite(xi)
    return (TriedGuess if tries else FirstFix).of(settings, then, xi, payload_size)


@dataclass(frozen=True)
class TriedGuess(FirstFix):
    """A first fix whose weights fall off steeply, and which searches only where the guess fails.

    Least squares on squared ranges find a target wherever it is, but one wrong range in three misleads them by tens of
    metres, and no iteration comes back from there. The guess tells which ranges are wrong, unless it is wrong itself.
    So a network tries it, and asks after a fifth and two fifths of the steps how many agents' ranges fit:

        step 1               squared ranges, of variance sigma^2/w with the weight w at the agent's guess
        steps 4 and 8 of 20  y_i = [mean w of the own ranges > 0.2] - c, 0 without a range;  average of y < 0: search
        all others           all ranges, linearised at the latest fix
        weight               w = min(1, xi s/|z|)^4,  s^2 = S + min((H dx)^2, 4^(steps - 5 - k) S)

    S is the innovation's variance, k the step: what a correction dx excuses halves from step to step, as in graduated
    non-convexity (Yang, Antonante, Tzoumas, Carlone, IEEE RA-L 5(2), 2020). With three axes any three ranges fit some
    place, so c is at least 3.5/n, and a half; at the first trial half of that. While the agents ask, a message says
    besides only what the newest range tells of the position, and the prediction takes that in. An agent whose guess
    failed forgets it, takes `squared` steps on squared ranges without weights, and goes on as the others. One that
    decides differently, as averaging has left off before all agree, shares in these steps what others cannot use, and
    comes back to them afterwards.
    """

    power: ClassVar[int] = 4

    def _share(self, belief: Belief, measurement: Measurement) -> Update:
        """The agent's share of the information in all ranges so far, or whether these fit."""
        latest, prior, seen, correction = self._history(belief, measurement)
        variance, rows = self._linearised(latest, seen, correction, measurement)
        joins = len(belief.memory) == 6  # and has no guess that could be tried
        left = belief.memory[-1] if belief.memory and not joins else np.full(len(latest.state), -1.0 if joins else 1.0)
        if self._asks(seen.steps):
            fits = self._fitting(rows, seen)[:, None]
            payload = self._filled(np.concatenate([fits, rows.newest], axis=1) if self.careful else fits)
        elif not np.count_nonzero(left > 0.0):
            payload = self._moving(prior, rows)
        else:
            wide = self._wide(prior, seen.steps)
            begins = left == self._squared_steps
            # At first the guess weighs ranges; a search begins without it.
            noise = variance if belief.memory else variance / rows.weight
            squared = self._at_rest(prior, _either(begins, wide, latest) if belief.memory else wide, seen, noise)
            payload = np.where((left > 0.0)[:, None], squared, self._moving(prior, rows))
        kept = prior.state, prior.known_covariance, seen.positions, seen.ages, seen.ranges, correction, left
        return Update(payload, rows.latest, (*kept, latest.state, latest.known_covariance))

    def _fixed(self, payload: Floats, update: Update) -> Belief:
        """The fix so far; after the last step of it, where the filter that follows begins."""
        *history, correction, left, predicted, covariance = update.kept
        step, prior = history[-1].shape[1], Belief(history[0], history[1])
        if self._asks(step):
            failed = (left == 0.0) & (payload[:, 0] < 0.0)
            prior = _either(failed, self._wide(prior, step), prior)
            left = np.where(failed, self._squared_steps, left)
            known = prior.state, prior.known_covariance
            fix = Belief(predicted, covariance)
            if self.careful:
                fix = self._ahead(fix, payload[:, 1:])
            return replace(fix, memory=(*known, *history[2:], correction, left))
        squares, squared = left > 0.0, self._squared(step)
        mixed, own = (_sound(part, ~squares, self.motion.size) for part in (payload, update.payload))
        fix = self._fix_moving(mixed, own)
        if np.count_nonzero(squares):
            mixed, own = (_sound(part, squares, squared.unknowns) for part in (payload, update.payload))
            fix = _either(squares, self._fix_at_rest(mixed, own, prior, step), fix)
        if step >= self.steps:
            return Belief(fix.state, fix.covariance, parts=(self._tied(fix, Seen(*history[2:5]), prior),))
        # A guess is tried once: below zero there is nothing left to be tried.
        left = np.where(squares, left - 1.0, left)
        left = np.where(squares & (left == 0.0) & (step > 1), -1.0, left)
        return replace(fix, memory=(*history, fix.state - predicted, left))

    def _ahead(self, latest: Belief, payload: Floats) -> Belief:
        """A fix that takes in the newest ranges only, from an average of what they tell of the position."""
        axes, more = self.space.axes, self.network_size * payload
        known = inverse(latest.known_covariance)
        matrix, vector = known.copy(), np.zeros_like(latest.state)
        matrix[:, :axes, :axes] += unpack_upper(more[:, axes : packed_size(axes)], axes)
        vector[:, :axes] = more[:, :axes]
        moved = belief_of(pack(vector, matrix), pack(np.zeros_like(vector), known), self.motion.size)
        return Belief(latest.state + moved.state, moved.covariance)

    def _asks(self, step: int) -> bool:
        return step in {self.steps // 5, 2 * self.steps // 5}

    def _fitting(self, rows: Rows, seen: Seen) -> Floats:
        """Whether agents' own ranges fit, less the share of agents that is enough, (n,); 0 without any range."""
        measured = np.isfinite(seen.ranges)
        count, size = measured.sum(axis=1), self.network_size
        mean = np.where(measured, rows.weight, 0.0).sum(axis=1) / np.maximum(count, 1)
        enough = min(max(0.5, (self.space.axes + 0.5) / size), 1.0 - 0.5 / size)
        early = seen.steps == self.steps // 5
        return np.where(count > 0, (mean > FITTING) - (FEWER if early else 1.0) * enough, 0.0)

    def _excused(self, moved: Floats, expected: Floats) -> Floats:
        step = moved.shape[1]
        most = 0.0 if self._asks(step) else 4.0 ** (self.steps - SURE - step)
        return np.minimum(moved, most * expected)


def _either(rows: Bools, first: Belief, second: Belief) -> Belief:
    """The first belief in some rows (n,), the second in the others."""
    return Belief(
        np.where(rows[:, None], first.state, second.state),
        np.where(rows[:, None, None], first.known_covariance, second.known_covariance),
    )


def _sound(payload: Floats, rows: Bools, size: int) -> Floats:
    """Payloads (n, d) of information on x (s,); those of other than some rows (n,) say nothing, soundly."""
    nothing = pack(np.zeros((1, size)), np.eye(size)[None])
    nothing = np.pad(nothing, ((0, 0), (0, payload.shape[1] - nothing.shape[1])))
    return np.ascontiguousarray(np.where(rows[:, None], payload, nothing))
