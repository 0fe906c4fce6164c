"""The network's first fix: nonlinear least squares on the ranges of the first steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.around.squared_ranges import Frame, Seen, SquaredRanges
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Filter, Floats, Update
from zenoh_cbef.tracking.filters.information_form import (
    belief_of,
    pack,
    packed_size,
    predict,
    saturation,
    told,
    variance_of,
)
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import inverse, matvec, neighbour_sum, outer
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Measurement, Space, own_range


@dataclass(frozen=True)
class FirstFix(Wrapping):
    """Least squares on all ranges of the first steps, one iteration a step, then another filter.

    A recursive filter that starts far off linearises at a wrong place, its covariance gets too small, and saturation
    then keeps it there. So in the first steps an agent keeps its ranges, and sends the information in all of them. In
    the first of these steps it squares the ranges, which makes them linear in the unknowns, and finds the side of the
    agents that the target is on, however wrong the initial estimate is (squared_ranges.py). Then it linearises all
    ranges again in every step at the latest estimate, which the agents agree on, carried back along its velocity
    (Gauss-Newton); the prior is the initial estimate:

        variance of a range that is t old:  sigma^2 + (q t^2/2)^2 + m beta^2
        saturation of innovation z:         w = min(1, xi s/|z|),  s^2 = H P H^T + variance + (H dx)^2

    dx is the latest iteration's correction: while it is large, no range counts as an outlier. The second term
    of the variance stands for the target's motion since then; the third keeps a bias of variance beta^2 from averaging
    out over the m ranges that an agent has. After the last of these steps `filter` starts from the fix.

    range_std: sigma (m). bias_std: beta (m). network_size: n. steps: how many it takes. payload_size: the filter's, to
    which messages are filled up. xi: saturation level in standard deviations. squared: how many steps are on squared
    ranges; None: half of them. search: where these look for the target, state (1, s) and covariance (1, s, s), the same
    for all agents; None: around the initial estimate, which has to be the same for all of them then.
    """

    motion: Motion
    space: Space
    range_std: float
    bias_std: float
    network_size: int
    steps: int
    payload_size: int
    xi: float = np.inf
    squared: int | None = None
    search: tuple[Floats, Floats] | None = None

    @classmethod
    def of(cls, settings: FilterSettings, then: Filter, xi: float, payload_size: int) -> Self:
        """The first fix before a filter. xi: saturation level in standard deviations. payload_size: the filter's."""
        bias_std = 0.0 if settings.bias == "none" else np.hypot(settings.common_bias_std, settings.own_bias_std)
        return cls(
            then,
            motion=settings.motion,
            space=settings.space,
            range_std=settings.range_std,
            bias_std=float(bias_std),
            network_size=settings.network_size,
            steps=settings.first_fix,
            payload_size=payload_size,
            xi=xi,
            squared=settings.squared_fix,
            search=settings.search,
        )

    @property
    def _squared(self) -> SquaredRanges:
        return SquaredRanges(self.space, self.network_size, self.xi)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The agent's share of the information in all ranges so far."""
        if belief.parts:
            inner = self.filter.update(belief.parts[0], measurement)
            return Update(inner.payload, inner.diagnostics, inner.kept, (inner,))
        state, covariance = predict(self.motion, belief)
        prior, seen, correction = self._history(belief, measurement)
        measured = np.isfinite(seen.ranges)
        alike = self.bias_std**2 * neighbour_sum(measured.astype(np.float64))
        variance = (variance_of(measurement, self.range_std) + alike)[:, None]
        drift = 0.5 * self.motion.acceleration_std * seen.ages**2
        rows = self._rows(seen, state, covariance, correction, variance + drift**2)
        if not self._squares(seen.steps):
            information = inverse(prior.known_covariance) / self.network_size
            payload = pack(
                matvec(information, prior.state) + neighbour_sum(rows.vectors),
                information + neighbour_sum(rows.matrices).reshape(information.shape),
            )
        else:
            axes, wide = self.space.axes, self._wide(prior, seen.steps)
            latest = Belief(state, covariance) if belief.memory else wide
            payload = self._squared.payload(
                self._frame(wide),
                Belief(latest.state[:, :axes], latest.known_covariance[:, :axes, :axes]),
                seen,
                variance=variance,
                speed=np.sqrt(wide.known_covariance[:, axes, axes]),
                guess=None if wide is prior else Belief(prior.state[:, :axes], prior.known_covariance[:, :axes, :axes]),
            )
        return Update(
            np.pad(payload, ((0, 0), (0, self.payload_size - payload.shape[1]))),
            rows.latest,
            (prior.state, prior.known_covariance, seen.positions, seen.ages, seen.ranges, state),
        )

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The fix so far; after the last step of it, where the filter that follows begins."""
        if update.parts:
            inner = self.filter.conclude(payload, update.parts[0])
            return Belief(inner.state, inner.covariance, inner.bias, parts=(inner,))
        *history, predicted = update.kept
        steps, size = history[-1].shape[1], self.motion.size
        if self._squares(steps):
            fix = self._at_rest(payload, update)
        else:
            own, mixed = (np.ascontiguousarray(part[:, : packed_size(size)]) for part in (update.payload, payload))
            averaged = belief_of(mixed, own, size)
            fix = Belief(averaged.state, averaged.known_covariance / self.network_size)
        if steps >= self.steps:
            return Belief(fix.state, fix.covariance, parts=(fix,))
        return replace(fix, memory=(*history, fix.state - predicted))

    def _at_rest(self, payload: Floats, update: Update) -> Belief:
        axes, prior = self.space.axes, Belief(update.kept[0], update.kept[1])
        wide = self._wide(prior, update.kept[-2].shape[1])
        place = self._squared.solve(payload, update.payload, self._frame(wide))
        covariance = np.array(prior.known_covariance)
        covariance[:, :axes] = covariance[:, :, :axes] = 0.0
        covariance[:, :axes, :axes] = place.known_covariance
        return Belief(np.concatenate([place.state, prior.state[:, axes:]], axis=1), covariance)

    def _squares(self, step: int) -> bool:
        return step <= (self.steps // 2 if self.squared is None else self.squared)

    def _wide(self, prior: Belief, step: int) -> Belief:
        """What the squared ranges start from, carried to a step."""
        if self.search is None:
            return prior
        state, covariance = self.search
        count = len(prior.state)
        wide = Belief(np.repeat(state, count, axis=0), np.repeat(covariance, count, axis=0))
        for _ in range(step):
            wide = Belief(*predict(self.motion, wide))
        return wide

    def _frame(self, prior: Belief) -> Frame:
        return Frame(prior.state[:, : self.space.axes], np.sqrt(prior.known_covariance[:, 0, 0]))

    def _history(self, belief: Belief, measurement: Measurement) -> tuple[Belief, Seen, Floats]:
        """The initial estimate carried to this step, what was measured so far, and the latest correction (n, s)."""
        new = Seen(measurement.position[:, None], measurement.age[:, None], measurement.range[:, None])
        if not belief.memory:
            return Belief(*predict(self.motion, belief)), new, np.zeros_like(belief.state)
        state, covariance, positions, ages, ranges, correction = belief.memory
        seen = Seen(
            np.concatenate([positions, new.positions], axis=1),
            np.concatenate([ages + self.motion.dt, new.ages], axis=1),
            np.concatenate([ranges, new.ranges], axis=1),
        )
        return Belief(*predict(self.motion, Belief(state, covariance))), seen, correction

    def _rows(self, seen: Seen, state: Floats, covariance: Floats, correction: Floats, variance: Floats) -> _Rows:
        """All ranges linearised at a state."""
        count, kept = seen.ranges.shape
        predicted, rows = own_range(
            self.space, np.repeat(state, kept, axis=0), seen.positions.reshape(-1, 3), seen.ages.ravel()
        )
        rows = rows.reshape(count, kept, -1)
        measured = np.isfinite(seen.ranges)
        innovation = np.where(measured, seen.ranges - predicted.reshape(count, kept), 0.0)
        expected = np.sum(rows * matvec(covariance[:, None], rows), axis=2) + variance
        spread = np.sqrt(expected + np.sum(rows * correction[:, None], axis=2) ** 2)
        weight = saturation(innovation, self.xi * spread)
        precision = np.where(measured, weight, 0.0) / variance
        equivalent = innovation + np.sum(rows * state[:, None], axis=2)
        squares = outer(rows, rows).reshape(count, kept, -1)
        return _Rows(
            (precision * equivalent)[:, :, None] * rows,
            precision[:, :, None] * squares,
            told(measured[:, -1], innovation[:, -1], weight[:, -1], spread[:, -1]),
        )


@dataclass(frozen=True)
class _Rows:
    """Information of each range, (n, k, s) and (n, k, s^2), and what is said of the latest one, (n,)."""

    vectors: Floats
    matrices: Floats
    latest: Diagnostics
