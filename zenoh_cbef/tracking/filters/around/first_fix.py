"""The network's first fix: nonlinear least squares on the ranges of the first steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

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
    which messages are filled up. xi: saturation level in standard deviations. ending: the power of the saturation in
    the second half of the steps, if it is more than `power`. squared: how many steps are on squared ranges; None: half
    of them. search: where these look for the target, state (1, s) and covariance (1, s, s), the same for all agents;
    None: around the initial estimate, which has to be the same for all of them then.
    """

    power: ClassVar[int] = 1
    """The power of the saturation: with 1 the fix is one wherever it begins."""

    motion: Motion
    space: Space
    range_std: float
    bias_std: float
    network_size: int
    steps: int
    payload_size: int
    xi: float = np.inf
    ending: int = 1
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
            ending=settings.ending,
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
        latest, prior, seen, correction = self._history(belief, measurement)
        variance, rows = self._linearised(latest, seen, correction, measurement)
        if self._squares(seen.steps):
            first = latest if belief.memory else self._wide(prior, seen.steps)
            payload = self._at_rest(prior, first, seen, variance)
        else:
            payload = self._moving(prior, rows)
        kept = prior.state, prior.known_covariance, seen.positions, seen.ages, seen.ranges, latest.state
        return Update(payload, rows.latest, kept)

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The fix so far; after the last step of it, where the filter that follows begins."""
        if update.parts:
            inner = self.filter.conclude(payload, update.parts[0])
            return Belief(inner.state, inner.covariance, inner.bias, parts=(inner,))
        *history, predicted = update.kept
        steps, prior = history[-1].shape[1], Belief(history[0], history[1])
        if self._squares(steps):
            fix = self._fix_at_rest(payload, update.payload, prior, steps)
        else:
            fix = self._fix_moving(payload, update.payload)
        if steps >= self.steps:
            return Belief(fix.state, fix.covariance, parts=(fix,))
        return replace(fix, memory=(*history, fix.state - predicted))

    def _at_rest(self, prior: Belief, latest: Belief, seen: Seen, variance: Floats) -> Floats:
        """The payload of squared ranges. latest: where their residuals are weighed; variance: of ranges, (n, k)."""
        axes, wide = self.space.axes, self._wide(prior, seen.steps)
        payload = self._squared.payload(
            self._frame(wide),
            Belief(latest.state[:, :axes], latest.known_covariance[:, :axes, :axes]),
            seen,
            variance=variance,
            speed=np.sqrt(wide.known_covariance[:, axes, axes]),
            guess=None if wide is prior else Belief(prior.state[:, :axes], prior.known_covariance[:, :axes, :axes]),
        )
        return self._filled(payload)

    def _moving(self, prior: Belief, rows: Rows) -> Floats:
        """The payload of linearised ranges."""
        information = inverse(prior.known_covariance) / self.network_size
        matrix = information + neighbour_sum(rows.matrices).reshape(information.shape)
        return self._filled(pack(matvec(information, prior.state) + neighbour_sum(rows.vectors), matrix))

    def _filled(self, payload: Floats) -> Floats:
        return np.pad(payload, ((0, 0), (0, self.payload_size - payload.shape[1])))

    def _fix_moving(self, payload: Floats, own: Floats) -> Belief:
        size = self.motion.size
        mixed, mine = (np.ascontiguousarray(part[:, : packed_size(size)]) for part in (payload, own))
        averaged = belief_of(mixed, mine, size)
        return Belief(averaged.state, averaged.known_covariance / self.network_size)

    def _fix_at_rest(self, payload: Floats, own: Floats, prior: Belief, step: int) -> Belief:
        axes = self.space.axes
        place = self._squared.solve(payload, own, self._frame(self._wide(prior, step)))
        covariance = np.array(prior.known_covariance)
        covariance[:, :axes] = covariance[:, :, :axes] = 0.0
        covariance[:, :axes, :axes] = place.known_covariance
        return Belief(np.concatenate([place.state, prior.state[:, axes:]], axis=1), covariance)

    def _squares(self, step: int) -> bool:
        return step <= self._squared_steps

    @property
    def _squared_steps(self) -> int:
        return self.steps // 2 if self.squared is None else self.squared

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

    def _history(self, belief: Belief, measurement: Measurement) -> tuple[Belief, Belief, Seen, Floats]:
        """Latest fix and initial estimate, carried to this step, ranges so far, and the latest correction (n, s)."""
        new = Seen(measurement.position[:, None], measurement.age[:, None], measurement.range[:, None])
        latest = Belief(*predict(self.motion, belief))
        if not belief.memory:
            return latest, latest, new, np.zeros_like(belief.state)
        state, covariance, positions, ages, ranges, correction = belief.memory[:6]
        seen = Seen(
            np.concatenate([positions, new.positions], axis=1),
            np.concatenate([ages + self.motion.dt, new.ages], axis=1),
            np.concatenate([ranges, new.ranges], axis=1),
        )
        return latest, Belief(*predict(self.motion, Belief(state, covariance))), seen, correction

    def _linearised(
        self, latest: Belief, seen: Seen, correction: Floats, measurement: Measurement
    ) -> tuple[Floats, Rows]:
        """Variance of the ranges but for motion, (n, 1), m^2, and all ranges linearised at the latest fix."""
        alike = self.bias_std**2 * neighbour_sum(np.isfinite(seen.ranges).astype(np.float64))
        variance = (variance_of(measurement, self.range_std) + alike)[:, None]
        drift = 0.5 * self.motion.acceleration_std * seen.ages**2
        return variance, self._rows(seen, latest.state, latest.known_covariance, correction, variance + drift**2)

    def _rows(self, seen: Seen, state: Floats, covariance: Floats, correction: Floats, variance: Floats) -> Rows:
        """All ranges linearised at a state."""
        count, kept = seen.ranges.shape
        predicted, rows = own_range(
            self.space, np.repeat(state, kept, axis=0), seen.positions.reshape(-1, 3), seen.ages.ravel()
        )
        rows = rows.reshape(count, kept, -1)
        measured = np.isfinite(seen.ranges)
        innovation = np.where(measured, seen.ranges - predicted.reshape(count, kept), 0.0)
        expected = np.sum(rows * matvec(covariance[:, None], rows), axis=2) + variance
        moved = np.sum(rows * correction[:, None], axis=2) ** 2
        spread = np.sqrt(expected + self._excused(moved, expected))
        weight = saturation(
            innovation, self.xi * spread, self.power if 2 * kept <= self.steps else max(self.power, self.ending)
        )
        precision = np.where(measured, weight, 0.0) / variance
        equivalent = innovation + np.sum(rows * state[:, None], axis=2)
        squares = outer(rows, rows).reshape(count, kept, -1)
        return Rows(
            (precision * equivalent)[:, :, None] * rows,
            precision[:, :, None] * squares,
            weight,
            told(measured[:, -1], innovation[:, -1], weight[:, -1], spread[:, -1]),
        )

    def _excused(self, moved: Floats, expected: Floats) -> Floats:
        """By how much a correction widens what ranges (n, k) may be off, m^2; moved: by how much it moved them."""
        del expected
        return moved


@dataclass(frozen=True)
class Rows:
    """Information of ranges, (n, k, s) and (n, k, s^2), their weights (n, k), and what is said of the latest, (n,)."""

    vectors: Floats
    matrices: Floats
    weight: Floats
    latest: Diagnostics
