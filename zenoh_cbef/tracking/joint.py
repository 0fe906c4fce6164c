"""The centralised filter with the network's options: biases, first fix, learned noise; the yardstick for those."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.central_models import CentralModels
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters import FilterSettings, make_filter, sharing_of
from zenoh_cbef.tracking.filters.around.auto_bias import mixed
from zenoh_cbef.tracking.filters.around.evidence import BEGIN, MEMORY, SQUARES, Evidence
from zenoh_cbef.tracking.filters.around.learned_noise import learned
from zenoh_cbef.tracking.filters.base import Belief, Shared, Tie, Tied, Update
from zenoh_cbef.tracking.filters.finding.tried_guess import first_fix
from zenoh_cbef.tracking.filters.models.biased_information import forgetting
from zenoh_cbef.tracking.filters.models.joint_biases import LEAST
from zenoh_cbef.tracking.filters.weighing import saturated_precision, saturation
from zenoh_cbef.tracking.linalg import inverse, matvec, solve
from zenoh_cbef.tracking.motion import linear
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours, own_range
from zenoh_cbef.tracking.reference import Ranges, each_step, stacked


def joint_centralized(
    initial: Belief, settings: FilterSettings, xi: float, *, positions: Floats, ranges: Floats, age: Floats
) -> tuple[Floats, Floats]:
    """One filter that sees every range at once, over K steps: states (r, K, 6) and covariances (r, K, 6, 6).

    With biases its state is (p, v, c, d_1 ... d_n), and beside it another one has a share s more, by which all ranges
    may be too long: a plain Kalman filter in which all correlations are kept, unlike
    the network's. The bias is weighed as in auto_bias.py, the noise learned as in learned_noise.py, and the first
    fix is the network's with an exact average. initial: (r, s), (r, s, s). positions: (r, n, K, 3). ranges, age:
    (r, n, K). xi: saturation level in standard deviations.
    """
    steps = each_step(positions=positions, ranges=ranges, age=age, range_std=settings.range_std)
    return stacked(settings.space, joint_beliefs(initial, settings, xi, ranges.shape[1], steps))


def joint_beliefs(
    initial: Belief, settings: FilterSettings, xi: float, agents: int, steps: Iterable[Ranges]
) -> Iterator[Belief]:
    """The same step by step, as far as the ranges go, of the target alone; the noise of the ranges is learned here."""
    fix = Belief(np.repeat(initial.state, agents, axis=0), np.repeat(initial.known_covariance, agents, axis=0))
    fixing, space = settings.first_fix > 0, settings.space
    filter_ = _Joint(settings, xi, initial, agents)
    for seen in steps:
        step = replace(seen, std=filter_.noise)
        if fixing:
            fix, update = _first_fix(settings, xi, fix, step)
            told = update.diagnostics.each(lambda values: values.reshape(-1, agents))
            filter_.learn(told.innovation, told.nis)
            belief = Belief(fix.state[::agents], fix.known_covariance[::agents])
            if fix.parts:
                fixing = False
                filter_.begin(belief, fix.parts[0].tied)
        else:
            belief = filter_.step(step)
        state, covariance = space.embed_state(belief.state), space.embed_covariance(belief.known_covariance)
        yield Belief(space.kept_states(state), space.kept_covariances(covariance))


def _first_fix(settings: FilterSettings, xi: float, fix: Belief, step: Ranges) -> tuple[Belief, Update]:
    runs, agents = step.range.shape
    rows = runs * agents
    # Of an agent that is not there the position may not be known, either.
    known = np.asarray(np.isfinite(step.position).all(axis=2))
    measurement = Measurement(
        np.where(known[:, :, None], step.position, 0.0).reshape(rows, 3),
        np.where(known, step.range, np.nan).ravel(),
        step.age.ravel(),
        *no_neighbours(rows),
        step.std.ravel(),
    )
    # The filter that follows is `_Joint`: the one that stands here is not asked.
    filter_ = first_fix(settings, make_filter("sicf", settings), xi, sharing_of("sicf", settings).payload_size)
    update = filter_.update(fix, measurement)
    average = update.payload.reshape(runs, agents, -1).mean(axis=1)
    return filter_.conclude(np.repeat(average, agents, axis=0), update), update


class _Joint:
    """The filter's state: a belief with biases, one without, what weighs them, and the noise of every receiver."""

    def __init__(self, settings: FilterSettings, xi: float, initial: Belief, agents: int) -> None:
        self.settings, self.xi, self.agents = settings, xi, agents
        runs = len(initial.state)
        self._sums, self._evidence = np.full((runs, 3), BEGIN), Evidence(settings.likelihoods)
        self._shares = SQUARES.begun(runs)
        how = xi, settings.power, settings.widens
        self._models = CentralModels(settings.switching, settings.space, *how) if settings.models else None
        self._scale, self._seen = np.zeros((runs, agents)), np.zeros((runs, agents))
        self.begin(initial)

    @property
    def noise(self) -> Floats:
        """Standard deviations of the ranges, (r, n), m."""
        return np.asarray(self.settings.range_std * np.exp(self._scale))

    def begin(self, initial: Belief, tied: Tie | None = None) -> None:
        """Start from a belief about (p, v). tied: what agents' ranges (r n) say of their biases, see `Belief`."""
        self._biased = self._plain = initial
        if self.settings.bias == "none":
            return  # A matrix of all agents' biases is not for many agents.
        settings, size = self.settings, self.settings.motion.size
        stds = [settings.common_bias_std, *[settings.own_bias_std] * self.agents]
        prior = np.square([*stds, settings.scale_std])
        if isinstance(tied, Shared):
            self._biased, self._scaled = (self._together(tied, each) for each in (prior[:-1], prior))
            return
        covariance = np.zeros((len(initial.state), size + len(prior), size + len(prior)))
        covariance[:, :size, :size] = initial.known_covariance
        covariance[:, size:, size:] = np.diag(prior)
        state = np.pad(initial.state, ((0, 0), (0, len(prior))))
        if isinstance(tied, Tied):
            biases = slice(size + 1, size + 1 + self.agents)
            each = tied.offset, tied.slope, tied.given
            offset, slope, given = (one.reshape(-1, self.agents, *one.shape[1:]) for one in each)
            cross = slope @ initial.known_covariance
            state[:, biases] = offset + matvec(slope, initial.state)
            covariance[:, biases, :size], covariance[:, :size, biases] = cross, cross.swapaxes(1, 2)
            covariance[:, biases, biases] = cross @ slope.swapaxes(1, 2) + given[:, :, None] * np.eye(self.agents)
        self._scaled = Belief(state, covariance)
        self._biased = Belief(state[:, :-1], covariance[:, :-1, :-1])

    def _together(self, told: Shared, prior: Floats) -> Belief:
        """What all agents' parts say together. prior: variances of biases, m^2, and perhaps of a share of ranges."""
        size, agents = self.settings.motion.size, self.agents
        kept = size + len(prior) - agents  # x, the agent's bias, and perhaps s
        places = np.zeros((agents, kept, size + len(prior)))
        places[:, range(size), range(size)] = 1.0
        places[:, size, size] = places[range(agents), size, range(size + 1, size + 1 + agents)] = 1.0
        places[:, size + 1 :, size + 1 + agents :] = 1.0
        vector = told.vector[:, :kept].reshape(-1, agents, kept)
        matrix = told.matrix[:, :kept, :kept].reshape(-1, agents, kept, kept)
        whole = np.add.reduce(places.swapaxes(1, 2) @ matrix @ places, axis=1)
        least, errors = LEAST * self.settings.range_std**2, range(size, size + len(prior))
        whole[:, errors, errors] += 1.0 / np.maximum(prior, least)
        covariance = inverse(whole)
        return Belief(matvec(covariance, np.add.reduce(matvec(places.swapaxes(1, 2), vector), axis=1)), covariance)

    def learn(self, innovation: Floats, nis: Floats) -> None:
        """Learn the noise from innovations (r, n) and their NIS."""
        if self.settings.learns_noise:
            self._scale, self._seen = learned(self._scale, self._seen, self.noise, innovation, nis)

    def step(self, step: Ranges) -> Belief:
        """One step of both filters."""
        if self._models is not None:
            self._plain, told = self._models.step(self._plain, step)
            self.learn(told.innovation, told.nis)
            return self._plain
        weight = self._evidence.weight(self._sums)
        self._plain, innovation, plain = self._kalman(self._plain, step, biased=False)
        if self.settings.bias == "none":
            self.learn(innovation, plain)
            return self._plain
        belief, other, biased = self._with_biases(step)
        if self.settings.bias == "estimate":
            self.learn(other, biased)
            return belief
        chosen = weight[:, None] > 0.5
        self.learn(np.where(chosen, other, innovation), np.where(chosen, biased, plain))
        new = self._evidence.of((innovation, plain), (other, biased)).sum(axis=1)
        self._sums = np.exp(-new[:, 2:] / MEMORY) * self._sums + new
        return Belief(*mixed(self._plain, belief, self._evidence.weight(self._sums)))

    def _with_biases(self, step: Ranges) -> tuple[Belief, Floats, Floats]:
        """The same of the filter with biases, or of two of them."""
        self._biased, innovation, nis = self._kalman(self._biased, step, biased=True)
        belief = self._target(self._biased)
        if not self.settings.scale_std:
            return belief, innovation, nis
        self._scaled, *other = self._kalman(self._scaled, step, biased=True)
        chosen = SQUARES.weight(self._shares)[:, None] > 0.5
        new = SQUARES.of((innovation, nis), (other[0], other[1])).sum(axis=1)
        self._shares = np.exp(-new[:, 2:] / MEMORY) * self._shares + new
        belief = Belief(*mixed(belief, self._target(self._scaled), SQUARES.weight(self._shares)))
        return belief, np.where(chosen, other[0], innovation), np.where(chosen, other[1], nis)

    def _target(self, belief: Belief) -> Belief:
        size = self.settings.motion.size
        return Belief(belief.state[:, :size], belief.known_covariance[:, :size, :size])

    def _kalman(self, belief: Belief, step: Ranges, *, biased: bool) -> tuple[Belief, Floats, Floats]:
        """Predict and take in all ranges; returns innovations' sizes and NIS (r, n) too."""
        state, covariance = self._predicted(belief, step, biased=biased)
        agents, size = self.agents, self.settings.motion.size
        predicted, rows = own_range(
            self.settings.space,
            np.repeat(state[:, :size], agents, axis=0),
            step.position.reshape(-1, 3),
            step.age.ravel(),
        )
        rows, predicted = rows.reshape(-1, agents, size), predicted.reshape(-1, agents)
        if biased:
            own = np.broadcast_to(np.eye(agents), (len(state), agents, agents))
            last = size + 1 + agents
            scale, distance = np.add.reduce(state[:, last:], axis=1)[:, None], predicted[:, :, None]
            predicted = predicted + scale * predicted + state[:, size, None] + state[:, size + 1 : last]
            rows = np.concatenate([rows * (1.0 + scale[:, :, None]), np.ones_like(distance), own, distance], axis=2)
            rows = rows[:, :, : state.shape[1]]
        measured = np.isfinite(step.range)
        innovation = np.where(measured, step.range - predicted, 0.0)
        spread = np.sqrt(np.sum(rows * (rows @ covariance), axis=2) + step.std**2)
        weight = saturation(innovation, self.xi * spread, self.settings.power)
        # The covariance form: the inverse of a covariance that holds a known bias does not exist.
        noise = np.where(measured, step.std**2 / weight, 1.0)
        if self.settings.widens:
            precision = saturated_precision(weight, step.std**2, spread, widens=self.settings.widens)
            noise = np.where(measured, 1.0 / precision, 1.0)
        rows = np.where(measured[:, :, None], rows, 0.0)
        cross = covariance @ np.swapaxes(rows, 1, 2)
        total = rows @ cross + noise[:, :, None] * np.eye(agents)
        gain = np.swapaxes(solve(total, np.swapaxes(cross, 1, 2)), 1, 2)
        covariance = covariance - gain @ np.swapaxes(cross, 1, 2)
        covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
        nis = np.where(measured, (innovation / spread) ** 2, np.nan)
        return Belief(state + matvec(gain, innovation), covariance), np.abs(innovation), nis

    def _predicted(self, belief: Belief, step: Ranges, *, biased: bool) -> tuple[Floats, Floats]:
        motion = self.settings.motion
        if not biased:
            return motion.predict_state(belief.state), motion.predict_covariance(belief.known_covariance, belief.state)
        size = motion.size
        transition = np.eye(belief.state.shape[1])
        transition[:size, :size] = linear(motion).transition
        covariance = transition @ belief.known_covariance @ transition.T
        covariance[:, :size, :size] += linear(motion).process_noise
        own = np.arange(size + 1, size + 1 + self.agents)
        variance = covariance[:, own, own]
        widened = (1.0 + forgetting(self.settings)) * variance
        widened = np.minimum(widened, np.maximum(variance, self.settings.own_bias_std**2))
        covariance[:, own, own] = np.where(np.isfinite(step.range), widened, variance)
        return matvec(transition, belief.state), covariance
