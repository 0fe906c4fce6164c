"""Several models of the target's motion, between which it switches: the arithmetic of their probabilities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.linalg import outer
from zenoh_cbef.tracking.motion import Motion, begun

Gaussian = tuple[Floats, Floats]
"""Means (n, s) and covariances (n, s, s)."""


@dataclass(frozen=True)
class Switching:
    """M models and how the target switches between them: a Markov chain, of which it leaves a model with `leaving`.

    The steps of the interacting multiple model filter (Blom and Bar-Shalom, IEEE TAC 33(8), 1988). leaving: probability
    in one step; every other model is then equally likely.
    """

    motions: tuple[Motion, ...]
    leaving: float

    @property
    def size(self) -> int:
        """Components of position and velocity, with which the states of all models begin."""
        return 2 * self.motions[0].axes

    def begun(self, state: Floats, covariance: Floats) -> tuple[Floats, list[Gaussian]]:
        """Equal probabilities (n, M), and all models' beliefs from one about position and velocity."""
        count = len(self.motions)
        return np.full((len(state), count), 1.0 / count), [begun(one, state, covariance) for one in self.motions]

    def mixed(self, chance: Floats, beliefs: list[Gaussian]) -> tuple[Floats, list[Gaussian]]:
        """Probabilities (n, M) of the next step, and what each model begins it with."""
        count = len(self.motions)
        other = self.leaving / max(1, count - 1)
        ahead = np.stack([other + (1.0 - self.leaving - other) * chance[:, j] for j in range(count)], axis=1)
        mixtures = []
        for j in range(count):
            weights = [chance[:, i] * (1.0 - self.leaving if i == j else other) / ahead[:, j] for i in range(count)]
            mixtures.append(moments(weights, [self._as_of(beliefs[i], i, j) for i in range(count)]))
        return ahead, mixtures

    def pairs(self, chance: Floats, later: Floats, beliefs: list[Gaussian]) -> Gaussian:
        """Position and velocity in a step and in the next one together: means (n, 2 s), covariances (n, 2 s, 2 s).

        chance, later: the models' probabilities (n, M) after the ranges of either step. beliefs: of the first.
        """
        count, size = len(self.motions), self.size
        other = self.leaving / max(1, count - 1)
        weights, parts = [], []
        for j, motion in enumerate(self.motions):
            share = later[:, j] / (other + (1.0 - self.leaving - other) * chance[:, j])
            for i in range(count):
                state, covariance = self._as_of(beliefs[i], i, j)
                cross = covariance @ np.swapaxes(motion.jacobian(state), -1, -2)
                ahead = motion.predict_covariance(covariance, state)
                now, both, then = (part[:, :size, :size] for part in (covariance, cross, ahead))
                mean = np.concatenate([state[:, :size], motion.predict_state(state)[:, :size]], axis=1)
                parts.append((mean, np.block([[now, both], [np.swapaxes(both, 1, 2), then]])))
                weights.append(chance[:, i] * (1.0 - self.leaving if i == j else other) * share)
        return moments(weights, parts)

    def weighed(self, ahead: Floats, misfits: Floats) -> Floats:
        """Probabilities (n, M) after a step, from those before it and the models' misfits: see `misfit`."""
        least = np.minimum.reduce(misfits, axis=1)[:, None]
        scaled = ahead * np.exp(-0.5 * (misfits - least))
        total = scaled[:, 0].copy()
        for j in range(1, scaled.shape[1]):
            total += scaled[:, j]
        return np.asarray(scaled / total[:, None])

    def combined(self, chance: Floats, beliefs: list[Gaussian]) -> Gaussian:
        """Mean and covariance of position and velocity, of the mixture of all models."""
        size, weights = self.size, [chance[:, j] for j in range(len(self.motions))]
        return moments(weights, [(state[:, :size], covariance[:, :size, :size]) for state, covariance in beliefs])

    def _as_of(self, belief: Gaussian, i: int, j: int) -> Gaussian:
        """A belief of model i in the components of j; of those that i does not have, j begins anew."""
        if type(self.motions[i]) is type(self.motions[j]):
            return belief
        state, covariance = belief
        return begun(self.motions[j], state[:, : self.size], covariance[:, : self.size, : self.size])


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
