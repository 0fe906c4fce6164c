"""The network's first fix: nonlinear least squares on the ranges of the first steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Filter, Update
from zenoh_cbef.tracking.filters.damping import Damping, corrected
from zenoh_cbef.tracking.filters.finding.prior import carried, together
from zenoh_cbef.tracking.filters.finding.remembered_ranges import Remembered, Rows, Wandering, contamination
from zenoh_cbef.tracking.filters.finding.squared_ranges import Frame, Seen, SquaredRanges
from zenoh_cbef.tracking.filters.information_form import belief_of, pack, packed_size, predict, told, variance_of
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.filters.weighing import saturation
from zenoh_cbef.tracking.linalg import BY_LIBRARY, Inversion, matvec, neighbour_sum
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Measurement, Space


@dataclass(frozen=True)
class FirstFix(Wrapping):
    """Least squares on all ranges of the first steps, one iteration a step, then another filter.

    A recursive filter that starts far off linearises at a wrong place, its covariance gets too small, and saturation
    then keeps it there. So in the first steps an agent keeps its ranges, and sends the information in all of them. In
    the first of these steps it squares the ranges, which makes them linear in the unknowns, and finds the side of the
    agents that the target is on, however wrong the initial estimate is (squared_ranges.py). Then it linearises all
    ranges again in every step at the latest estimate, which the agents agree on, carried back along its velocity
    (Gauss-Newton); the prior is the initial estimate:

        variance of a range that is t old:  sigma^2 + q^2 D t^3/3 + m beta^2
        saturation of innovation z:         w = min(1, xi s/|z|),  s^2 = H P H^T + variance + (H dx)^2

    dx is the latest iteration's correction: while it is large, no range counts as an outlier. The second term
    of the variance stands for the target's motion since then, which all ranges have in common (Wandering); the third
    keeps a bias of variance beta^2 from averaging out over the m ranges that an agent has. Where guesses of position
    and velocity are independent of one another, their mean is the prior, and surer than each by their number. After the
    last of these steps `filter` starts from the fix.

    range_std: sigma (m). bias_std: beta (m). network_size: n. steps: how many it takes. payload_size: the filter's, to
    which messages are filled up. xi: saturation level in standard deviations. ending: the power of the saturation in
    the second half of the steps, if it is more than `power`. squared: how many steps are on squared ranges; None: half
    of them. search: where these look for the target, state (1, s) and covariance (1, s, s), the same for all agents;
    None: around the initial estimate, which has to be the same for all of them then. guesses: how many of position and
    of velocity are independent; None: one, and by rules before the fourth, which knew nothing of outliers, took the
    motion for noise of every range by itself, (q t^2/2)^2, left velocities alone in squared steps, and |q|^2 an unknown
    of its own. outliers: what share of the ranges are too long, and by how much on average, m (contamination).
    own_bias_std: of the agents' own biases, m, where beta^2 is counted as an error that all m ranges share, and not as
    m beta^2 in each, and the filter begins with what the fix says of these biases; 0: neither. shares: whether it does,
    of biases with a common part. least: the least range that is squared, m. joins: whether an agent that begins anew
    joins a fix that is under way. inversion: of matrices. damping: of corrections, if any.
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
    guesses: tuple[int, int] | None = (1, 1)
    outliers: tuple[float, float] | None = None
    own_bias_std: float = 0.0
    shares: bool = False
    least: float = -np.inf
    joins: bool = False
    inversion: Inversion = BY_LIBRARY
    damping: Damping | None = None

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
            ending=settings.power if settings.outliers else 1,
            outliers=settings.outliers,
            squared=settings.squared_fix,
            search=settings.search,
            guesses=settings.guesses,
            own_bias_std=settings.own_bias_std if settings.told_biases else 0.0,
            shares=settings.whole_biases and settings.joint_biases and settings.common_bias_std > 0.0,
            least=settings.least,
            joins=settings.joins_fix and settings.search is not None,
            inversion=settings.inversion,
            damping=settings.damping,
        )

    @property
    def careful(self) -> bool:
        """Whether the fix counts once what its ranges have in common, by the fourth rules."""
        return self.guesses is not None

    def _squared(self, step: int) -> SquaredRanges:
        return SquaredRanges(self.space, self.network_size, self.xi, step > 1 or not self.careful, self.least)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The agent's share of the information in all ranges so far; after the fix the filter's update."""
        belief = self._joined(belief, measurement.step) if self.joins and belief.parts else belief
        if belief.parts:
            inner = self.filter.update(belief.parts[0], measurement)
            return Update(inner.payload, inner.diagnostics, inner.kept, (inner,))
        return self._share(belief, measurement)

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The fix so far; after the last step of it, where the filter that follows begins, and then its belief."""
        if update.parts:
            inner = self.filter.conclude(payload, update.parts[0])
            return Belief(inner.state, inner.covariance, inner.bias, parts=(inner,))
        return self._fixed(payload, update)

    def resumed(self, belief: Belief) -> Belief:
        """A belief of neighbours, marked: only the step that follows tells whether the fix is still under way."""
        return replace(super().resumed(belief), memory=(np.ones(len(belief.state)),) * self.joins)

    def _joined(self, belief: Belief, step: int | None) -> Belief:
        """The belief of an agent that begins anew without ranges and a guess, in a fix if that is still under way."""
        if not belief.memory or step is None or step > self.steps:
            return belief
        prior, nothing = self._wide(belief, step - 1), Seen.nothing(len(belief.state), step - 1)
        known = prior.state, prior.known_covariance
        return Belief(belief.state, belief.covariance, memory=(*known, *nothing, np.zeros_like(belief.state)))

    def _share(self, belief: Belief, measurement: Measurement) -> Update:
        """The update of a step of the fix."""
        latest, prior, seen, correction = self._history(belief, measurement)
        variance, rows = self._linearised(latest, seen, correction, measurement)
        if seen.steps <= self._squared_steps:
            first = latest if belief.memory else self._wide(prior, seen.steps)
            payload = self._at_rest(prior, first, seen, variance)
        else:
            payload = self._moving(prior, rows)
        kept = prior.state, prior.known_covariance, seen.positions, seen.ages, seen.ranges, latest.state
        return Update(payload, rows.latest, kept)

    def _fixed(self, payload: Floats, update: Update) -> Belief:
        """What a step of the fix finds."""
        *history, predicted = update.kept
        steps, prior = history[-1].shape[1], Belief(history[0], history[1])
        both, squares = (payload, update.payload), steps <= self._squared_steps
        fix = self._fix_at_rest(*both, prior, steps) if squares else self._fix_moving(*both)
        state, correction = corrected(self.damping, predicted, fix.state, steps - self._squared_steps)
        fix = Belief(state, fix.covariance)
        if steps >= self.steps:
            return replace(fix, parts=(self._tied(fix, Seen(*history[2:]), prior),))
        return replace(fix, memory=(*history, correction))

    def _tied(self, fix: Belief, seen: Seen, prior: Belief) -> Belief:
        """The fix, with what the agent's ranges say of its bias. prior: what was known before them."""
        if not (self.own_bias_std or self.shares):
            return fix
        ranges = Remembered.at(self.space, fix.state, seen)
        variance = np.full_like(ranges.ages, self.range_std**2)
        drift = self.wandering.covariance(ranges.ages, ranges.ages)
        spread = np.sqrt(ranges.expected(fix.known_covariance) + variance + drift + self.bias_std**2)
        weight = saturation(ranges.innovation, self.xi * spread, max(self.power, self.ending))
        how = weight, variance, self.wandering, self.space.axes
        if not self.shares:
            return replace(fix, tied=ranges.constant_given(*how, self.own_bias_std**2))
        return replace(fix, tied=ranges.shared(*how, prior, agents=self.network_size, inversion=self.inversion))

    def _at_rest(self, prior: Belief, latest: Belief, seen: Seen, variance: Floats) -> Floats:
        """The payload of squared ranges. latest: where their residuals are weighed; variance: of ranges, (n, k)."""
        axes, wide = self.space.axes, self._wide(prior, seen.steps)
        squared = self._squared(seen.steps)
        payload = squared.payload(
            self._frame(wide),
            Belief(latest.state[:, :axes], latest.known_covariance[:, :axes, :axes]),
            seen,
            variance=variance,
            speed=np.sqrt(wide.known_covariance[:, axes, axes]),
            guess=None if wide is prior else Belief(prior.state[:, :axes], prior.known_covariance[:, :axes, :axes]),
        )
        rest = prior.state[:, self._others(seen.steps)]
        return self._filled(np.concatenate([payload, rest], axis=1))

    def _moving(self, prior: Belief, rows: Rows) -> Floats:
        """The payload of linearised ranges."""
        information = self.inversion.inverse(prior.known_covariance) / self.network_size
        return self._filled(pack(matvec(information, prior.state) + rows.vector, information + rows.matrix))

    def _filled(self, payload: Floats) -> Floats:
        return np.pad(payload, ((0, 0), (0, self.payload_size - payload.shape[1])))

    def _fix_moving(self, payload: Floats, own: Floats) -> Belief:
        size = self.motion.size
        mixed, mine = (np.ascontiguousarray(part[:, : packed_size(size)]) for part in (payload, own))
        return belief_of(mixed, mine, size, self.network_size, self.inversion)

    def _fix_at_rest(self, payload: Floats, own: Floats, prior: Belief, step: int) -> Belief:
        axes, squared, others = self.space.axes, self._squared(step), self._others(step)
        frame = self._frame(self._wide(prior, step))
        place = squared.solve(payload, own, frame, joined=self.careful)
        covariance = np.array(prior.known_covariance)
        covariance[:, :axes] = covariance[:, :, :axes] = 0.0
        covariance[:, :axes, :axes] = place.known_covariance
        state = np.concatenate([place.state, prior.state[:, axes:]], axis=1)
        state[:, others] = payload[:, squared.size :][:, : state[:, others].shape[1]]
        return Belief(state, covariance)

    def _others(self, step: int) -> slice:
        """The components of a state that agents average beside squared ranges: all others, where there is room."""
        axes, size = self.space.axes, self.motion.size
        room = self.payload_size - self._squared(step).size
        return slice(axes, size if self.careful and room >= size - axes else axes)

    @property
    def _squared_steps(self) -> int:
        return self.steps // 2 if self.squared is None else self.squared

    def _wide(self, prior: Belief, step: int) -> Belief:
        """What the squared ranges start from, carried to a step."""
        return prior if self.search is None else carried(self.motion, self.search, step, len(prior.state))

    def _frame(self, prior: Belief) -> Frame:
        return Frame(prior.state[:, : self.space.axes], np.sqrt(prior.known_covariance[:, 0, 0]))

    def _history(self, belief: Belief, measurement: Measurement) -> tuple[Belief, Belief, Seen, Floats]:
        """Latest fix and initial estimate, carried to this step, ranges so far, and the latest correction (n, s)."""
        new = Seen(measurement.position[:, None], measurement.age[:, None], measurement.range[:, None])
        latest = Belief(*predict(self.motion, belief))
        if not belief.memory:
            prior = together(self.motion, self.space.axes, self.guesses or (1, 1), belief)
            return latest, prior, new, np.zeros_like(belief.state)
        state, covariance, positions, ages, ranges, correction = belief.memory[:6]
        if measurement.forgets:
            ranges = np.full_like(ranges, np.nan)
        seen = Seen(positions, ages, ranges).followed_by(new, self.motion.dt)
        return latest, Belief(*predict(self.motion, Belief(state, covariance))), seen, correction

    def _linearised(
        self, latest: Belief, seen: Seen, correction: Floats, measurement: Measurement
    ) -> tuple[Floats, Rows]:
        """Variance of the ranges but for motion, m^2, (n, 1) or (n, k), and all ranges linearised at the latest fix."""
        alike = self.bias_std**2 * neighbour_sum(np.isfinite(seen.ranges).astype(np.float64))
        variance = (variance_of(measurement, self.range_std) + alike)[:, None]
        ranges = Remembered.at(self.space, latest.state, seen)
        if self.outliers and self.careful:
            expected = ranges.expected(latest.known_covariance) + variance
            # In the first step squared ranges are not weighed yet.
            level = self.xi * np.sqrt(expected) if seen.steps > 1 else np.full_like(expected, np.inf)
            variance = variance + contamination(*self.outliers, level)
        noise, constant = (variance - alike[:, None], self.bias_std**2) if self.own_bias_std else (variance, 0.0)
        rows = self._rows(ranges, latest, correction, noise, constant)
        return variance, rows if measurement.overcounted is None else rows.counted(measurement.overcounted)

    def _rows(
        self, ranges: Remembered, latest: Belief, correction: Floats, noise: Floats, constant: float = 0.0
    ) -> Rows:
        """All ranges, weighed. constant: variance of an error that all ranges of an agent share, m^2."""
        variance = noise + constant
        drift = self.wandering.covariance(ranges.ages, ranges.ages)
        if not self.careful:
            drift = (0.5 * self.motion.acceleration_std * ranges.ages**2) ** 2
        expected = ranges.expected(latest.known_covariance) + (variance + drift)
        moved = np.sum(ranges.rows * correction[:, None], axis=2) ** 2
        spread = np.sqrt(expected + self._excused(moved, expected))
        power = self.power if 2 * ranges.ages.shape[1] <= self.steps else max(self.power, self.ending)
        weight = saturation(ranges.innovation, self.xi * spread, power)
        if self.careful:
            vector, matrix = ranges.joint_information(
                weight, noise, self.wandering, self.space.axes, constant, inversion=self.inversion
            )
        else:
            vector, matrix = ranges.information(weight, variance + drift)
        newest = ranges.newest(weight, variance, self.space.axes)
        last = told(ranges.measured[:, -1], ranges.innovation[:, -1], weight[:, -1], spread[:, -1])
        return Rows(vector, matrix, newest, weight, last)

    @property
    def wandering(self) -> Wandering:
        """How far the target is off the straight line that its latest state tells."""
        share = max(1.0, self.network_size / self.space.axes)
        return Wandering(self.motion.acceleration_std**2 * self.motion.dt, share)

    def _excused(self, moved: Floats, expected: Floats) -> Floats:  # noqa: ARG002 - a tried guess needs it
        """By how much a correction widens what ranges (n, k) may be off, m^2; moved: by how much it moved them."""
        return moved
