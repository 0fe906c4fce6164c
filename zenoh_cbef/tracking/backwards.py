"""What an estimate and the motion say of a step, given the next one: what smoothers go back by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.linalg import matvec, solve
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.switching import Gaussian, Switching


@dataclass(frozen=True)
class Backward:
    """What is known of x(k), given x(k+1) and the ranges up to step k: x(k) ~ N(m + C x(k+1), D).

        C = P A^T (A P A^T + Q)^-1,   m = x - C A x,   D = (I - C A) P (I - C A)^T + C Q C^T

    for the filter's estimate x with covariance P of step k: the backward pass of Rauch, Tung and Striebel (AIAA
    Journal 3(8), 1965) with its parts in another order, so that D is positive semidefinite whatever the filter did.

    offset: m, (n, s). gain: C, (n, s, s). rest: D, (n, s, s).
    """

    offset: Floats
    gain: Floats
    rest: Floats

    @classmethod
    def of(cls, belief: Belief, motion: Motion) -> Backward:
        """From the filter's estimates of step k, (n, s) and (n, s, s), at which the motion is linearised."""
        state, covariance = belief.state, belief.known_covariance
        ahead = motion.jacobian(state)
        gain = _gain(motion.predict_covariance(covariance, state), ahead @ covariance)
        rest = _sandwich(np.eye(motion.size) - gain @ ahead, covariance) + _sandwich(gain, motion.process_noise)
        return cls(state - matvec(gain, motion.predict_state(state)), gain, rest)

    @classmethod
    def within(cls, joint: Gaussian) -> Backward:
        """From mean (n, 2 s) and covariance (n, 2 s, 2 s) of both steps together: the regression on the second."""
        mean, spread = joint
        size = mean.shape[1] // 2
        first, second = (np.ascontiguousarray(part) for part in (spread[:, :size, :size], spread[:, size:, size:]))
        gain = _gain(second, spread[:, size:, :size])
        rest = first - _sandwich(gain, second)
        return cls(mean[:, :size] - matvec(gain, np.ascontiguousarray(mean[:, size:])), gain, rest)

    def carried(self, state: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """The smoothed estimates of step k from those of step k + 1."""
        return self.offset + matvec(self.gain, state), self.rest + _sandwich(self.gain, covariance)


def _gain(predicted: Floats, cross: Floats) -> Floats:
    """C, from the covariance of the next step (n, s, s) and its covariance with this one."""
    return solve(predicted, cross).swapaxes(-1, -2)


def _sandwich(left: Floats, middle: Floats) -> Floats:
    """L M L^T per row, symmetric to the last bit."""
    product = left @ middle @ left.swapaxes(-1, -2)
    return np.asarray(0.5 * (product + product.swapaxes(-1, -2)))


class Backwards(Protocol):
    """The way back from one step to the one before."""

    def kept(self, belief: Belief) -> Belief:
        """What of the filter's belief of a step is needed later."""

    def between(self, before: Belief, after: Belief) -> Backward:
        """The way back between two beliefs that were kept."""


@dataclass(frozen=True)
class OneMotion:
    """The way back of a filter with one model of the motion."""

    motion: Motion

    def kept(self, belief: Belief) -> Belief:
        """State and covariance, as the filter goes on with them: what errors that last add to it is no information."""
        covariance = belief.known_covariance
        if belief.excess is not None:
            covariance = covariance / (1.0 + belief.excess)[:, None, None]
        # Products of matrices depend on how these lie in memory, and that on how many agents there are.
        return Belief(np.ascontiguousarray(belief.state), np.ascontiguousarray(covariance))

    def between(self, before: Belief, after: Belief) -> Backward:  # noqa: ARG002
        """By the model alone."""
        return Backward.of(before, self.motion)


@dataclass(frozen=True)
class SeveralMotions:
    """The way back of a filter with several models: the mixture of all pairs of them, with its first two moments.

    A pair counts as much as it is likely after the later step's ranges, so a turn that the filter notices a step late
    is not late for the smoother. Position and velocity are smoothed; what else models estimate is averaged out.
    """

    switching: Switching

    def kept(self, belief: Belief) -> Belief:
        """Probabilities and beliefs of all models, wherever they stand in it; during a first fix, all models alike."""
        if (found := _motions(belief)) is not None:
            if not self.switching.unseen:
                return found
            # A turn that the ranges of a step do not show those of the next one do.
            beliefs = [(one.state, one.known_covariance) for one in found.parts]
            covariance, size = self.switching.combined(found.known_chance, beliefs)[1], found.state.shape[1]
            return replace(found, covariance=np.ascontiguousarray(covariance[:, :size, :size]))
        chance, beliefs = self.switching.begun(belief.state, belief.known_covariance)
        return Belief(belief.state, belief.covariance, chance=chance, parts=tuple(Belief(*one) for one in beliefs))

    def between(self, before: Belief, after: Belief) -> Backward:
        """By all pairs of models."""
        beliefs = [(one.state, one.known_covariance) for one in before.parts]
        return Backward.within(self.switching.pairs(before.known_chance, after.known_chance, beliefs))


def _motions(belief: Belief) -> Belief | None:
    """The belief of several motions in another one, wherever it stands in that; None where there is none."""
    if belief.chance is not None:
        return belief
    return next((found for part in belief.parts if (found := _motions(part))), None)
