"""Several models of the target's motion, between which it switches: the arithmetic of their probabilities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.linalg import outer
from zenoh_cbef.tracking.motion import Motion, begun, constants_of, moving_of

Gaussian = tuple[Floats, Floats]
"""Means (n, s) and covariances (n, s, s)."""

Several = tuple[Floats, Floats, Floats]
"""Means (n, k, s) and covariances (n, k, s, s) of k Gaussians, and logarithms of their weights, (n, k)."""

_CHANGES = 0.001
"""The probability that, in a step, the target takes to leaving its models more or less often."""


@dataclass(frozen=True)
class Switching:
    """M models and how the target switches between them: a Markov chain, of which it leaves a model with `leaving`.

    The steps of the interacting multiple model filter (Blom and Bar-Shalom, IEEE TAC 33(8), 1988). leaving: probability
    in one step; every other model is then equally likely. Where several are given, the ranges decide between them: the
    chain is one of pairs, of a probability to leave and a model, and all pairs of one model have that model's estimate.
    So probabilities of pairs are (n, R M) for R such probabilities, all models of the first one first.

    nearer: models differ in their noise, and the next one is likelier near the last (see `to_noises`). unseen: what is
    claimed allows for a turn that ranges do not show yet (see `claimed`).
    """

    motions: tuple[Motion, ...]
    leaving: tuple[float, ...]
    nearer: bool = False
    unseen: bool = False

    @property
    def size(self) -> int:
        """Components of position and velocity, and constants, with which the states of all models begin."""
        return 2 * self.motions[0].axes + constants_of(self.motions[0])

    def begun(self, state: Floats, covariance: Floats) -> tuple[Floats, list[Gaussian]]:
        """Equal probabilities (n, R M), and all models' beliefs from one about position and velocity."""
        count = len(self.leaving) * len(self.motions)
        return np.full((len(state), count), 1.0 / count), [begun(one, state, covariance) for one in self.motions]

    def mixed(self, chance: Floats, beliefs: list[Gaussian]) -> tuple[Floats, list[Gaussian]]:
        """Probabilities (n, R M) of the next step, and what each model begins it with."""
        ahead, ways = self._chain(chance)
        likely, mixtures = self.of_models(ahead), []
        for j in range(len(self.motions)):
            weights = [way / likely[:, j] for way in ways[j]]
            mixtures.append(moments(weights, [self._as_of(one, i, j) for i, one in enumerate(beliefs)]))
        return ahead, mixtures

    def apart(self, chance: Floats, beliefs: list[Several]) -> tuple[Floats, list[Several]]:
        """As `mixed`, of k Gaussians for each model, which are not mixed: each model begins with M k of them."""
        ahead, ways = self._chain(chance)
        likely, found = self.of_models(ahead), []
        for j in range(len(self.motions)):
            parts = []
            for i, (states, covariances, weights) in enumerate(beliefs):
                flat = states.reshape(-1, states.shape[2]), covariances.reshape(-1, *covariances.shape[2:])
                state, covariance = self._as_of(flat, i, j)
                way = np.log(np.maximum(ways[j][i] / likely[:, j], np.finfo(np.float64).tiny))[:, None]
                each = weights.shape
                shaped = state.reshape(*each, -1), covariance.reshape(*each, *covariance.shape[1:])
                parts.append((*shaped, weights + way))
            first, second, third = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
            found.append((first, second, third))
        return ahead, found

    def of_models(self, chance: Floats) -> Floats:
        """Probabilities (n, M) of the models, whatever the probability to leave one."""
        return _over_rates(chance, len(self.motions))

    def pairs(self, chance: Floats, later: Floats, beliefs: list[Gaussian]) -> Gaussian:
        """Position and velocity in a step and in the next one together: means (n, 2 s), covariances (n, 2 s, 2 s).

        chance, later: probabilities (n, R M) after the ranges of either step. beliefs: of the first.
        """
        size, weights, parts = 2 * self.motions[0].axes, [], []
        ahead, ways = self._chain(chance)
        shares = self.of_models(later) / self.of_models(ahead)
        for j, motion in enumerate(self.motions):
            for i, one in enumerate(beliefs):
                state, covariance = self._as_of(one, i, j)
                cross = covariance @ np.swapaxes(motion.jacobian(state), -1, -2)
                ahead_of = motion.predict_covariance(covariance, state)
                now, both, then = (part[:, :size, :size] for part in (covariance, cross, ahead_of))
                mean = np.concatenate([state[:, :size], motion.predict_state(state)[:, :size]], axis=1)
                parts.append((mean, np.block([[now, both], [np.swapaxes(both, 1, 2), then]])))
                weights.append(ways[j][i] * shares[:, j])
        return moments(weights, parts)

    def _chain(self, chance: Floats) -> tuple[Floats, list[list[Floats]]]:
        """Probabilities (n, R M) of the next step; and for each model j those, (n,), to come there from each model."""
        count = len(self.motions)
        before = _drifted(chance, count) if len(self.leaving) > 1 else chance
        ways, ahead = [[np.zeros(len(chance))] * count for _ in range(count)], []
        for rate, leaving in enumerate(self.leaving):
            these = before[:, rate * count : (rate + 1) * count]
            if self.nearer:
                moves = these[:, :, None] * to_noises(self.motions, leaving)
                ahead += [np.add.reduce(moves[:, :, j], axis=1) for j in range(count)]
                ways = [[ways[j][i] + moves[:, i, j] for i in range(count)] for j in range(count)]
                continue
            total = np.add.reduce(these, axis=1) if len(self.leaving) > 1 else 1.0
            other = leaving / max(1, count - 1)
            for j in range(count):
                ahead.append(other * total + (1.0 - leaving - other) * these[:, j])
                for i in range(count):
                    ways[j][i] = ways[j][i] + these[:, i] * (1.0 - leaving if i == j else other)
        return np.stack(ahead, axis=1), ways

    def weighed(self, ahead: Floats, misfits: Floats) -> Floats:
        """Probabilities (n, R M) after a step, from those before it and the models' misfits (n, M): see `misfit`."""
        least = np.minimum.reduce(misfits, axis=1)[:, None]
        scaled = ahead * np.tile(np.exp(-0.5 * (misfits - least)), len(self.leaving))
        total = scaled[:, 0].copy()
        for j in range(1, scaled.shape[1]):
            total += scaled[:, j]
        return np.asarray(scaled / total[:, None])

    def combined(self, chance: Floats, beliefs: list[Gaussian]) -> Gaussian:
        """Mean and covariance of position and velocity, and of constants, of the mixture of all models."""
        size, likely = self.size, self.of_models(chance)
        weights = [likely[:, j] for j in range(len(self.motions))]
        return moments(weights, [(state[:, :size], covariance[:, :size, :size]) for state, covariance in beliefs])

    def claimed(self, chance: Floats, beliefs: list[Gaussian]) -> Gaussian:
        """As `combined`, and for a turn in the last part of the step, which ranges do not show yet.

        A target that turns at t before the end of the step, and goes on as fast in any direction, changes its velocity
        by s in each axis, s^2 = 2 |v|^2/axes, and its position by s t. The most agile model has such jumps at any t,
        but as one Gaussian: where the place fits the other models it excludes a late turn, too. Ranges tell the
        position to S in each axis, by that model's estimate, so they leave the part S/(s D) of all turns in a step D.
        As far as that is likelier than the model itself, s^2 is added to the variance of the velocity.
        """
        mean, covariance = self.combined(chance, beliefs)
        if not self.unseen:
            return mean, covariance
        axes, step = self.motions[-1].axes, self.motions[-1].dt
        into = self._chain(chance)[1][-1]
        turns = np.add.reduce(np.stack(into[:-1]), axis=0)
        told = np.exp(np.linalg.slogdet(beliefs[-1][1][:, :axes, :axes])[1] / (2 * axes))
        square = 2.0 / axes * np.add.reduce(mean[:, axes : 2 * axes] ** 2, axis=1)
        late = np.minimum(told / np.maximum(np.sqrt(square) * step, np.finfo(np.float64).tiny), 1.0)
        more = np.maximum(turns * late - self.of_models(chance)[:, -1], 0.0) * square
        covariance[:, range(axes, 2 * axes), range(axes, 2 * axes)] += more[:, None]
        return mean, covariance

    def _as_of(self, belief: Gaussian, i: int, j: int) -> Gaussian:
        """A belief of model i in the components of j; of those that i does not have, j begins anew."""
        if type(moving_of(self.motions[i])) is type(moving_of(self.motions[j])):
            return belief
        state, covariance = belief
        return begun(self.motions[j], state[:, : self.size], covariance[:, : self.size, : self.size])


def to_noises(motions: Sequence[Motion], leaving: float) -> Floats:
    """Probabilities (M, M) that the target goes from one noise to another in a step.

    It rather changes a little: to twice or half the noise is twice as likely as to four times or a quarter of it. Were
    all others as likely, the largest would say most of what the velocity may be.
    """
    noise = np.array([one.acceleration_std for one in motions])
    shares = np.minimum(noise[:, None] / noise, noise / noise[:, None]) - np.eye(len(noise))
    return np.asarray(leaving * shares / np.add.reduce(shares, axis=1)[:, None] + (1.0 - leaving) * np.eye(len(noise)))


def _over_rates(chance: Floats, count: int) -> Floats:
    """Sums (n, count) over the probabilities to leave a model."""
    total = chance[:, :count].copy()
    for start in range(count, chance.shape[1], count):
        total += chance[:, start : start + count]
    return total


def _drifted(chance: Floats, count: int) -> Floats:
    """Probabilities a step later, as now and then the target takes to another probability to leave a model."""
    rates = chance.shape[1] // count
    return np.asarray((1.0 - _CHANGES) * chance + _CHANGES / rates * np.tile(_over_rates(chance, count), rates))


def moments(weights: list[Floats], parts: list[Gaussian]) -> Gaussian:
    """Mean and covariance of a mixture of Gaussians. weights: (n,) each."""
    mean = sum(weight[:, None] * state for weight, (state, _) in zip(weights, parts, strict=True))
    spread = sum(
        weight[:, None, None] * (covariance + outer(state - mean, state - mean))
        for weight, (state, covariance) in zip(weights, parts, strict=True)
    )
    return np.asarray(mean), np.asarray(spread)


def misfit(cost: Floats, prior: Floats, posterior: Floats) -> Floats:
    """-2 log likelihood of all ranges together under one model, (n,), but for what is the same for all models.

        min_x [ (x - x-)^T P-^-1 (x - x-) + sum_i w_i (z_i - H_i (x - x-))^2/sigma_i^2 ] - sum_i log w_i
        + log det P- - log det P+

    which is z^T S^-1 z + log det S for all agents' innovations z together, by the matrix inversion lemmas, with
    S = H P- H^T + R and R = diag(sigma^2/w). cost: (n,), the first line. prior, posterior: P- and P+, (n, s, s).
    """
    volume = np.linalg.slogdet(prior)[1] - np.linalg.slogdet(posterior)[1]
    return np.asarray(np.maximum(cost, 0.0) + volume)
