"""What a first fix starts from: what agents guess together, or the target anywhere."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.information_form import predict
from zenoh_cbef.tracking.linalg import outer
from zenoh_cbef.tracking.motion import Motion


def together(motion: Motion, axes: int, guesses: tuple[int, int], belief: Belief) -> Belief:
    """The initial estimates, carried to the first step, with what all of them together are worth.

    guesses: how many of position and of velocity are independent.
    """
    scale = np.ones(motion.size)
    scale[:axes], scale[axes : 2 * axes] = (number**-0.5 for number in guesses)
    return Belief(*predict(motion, Belief(belief.state, belief.known_covariance * outer(scale, scale))))


def carried(motion: Motion, search: tuple[Floats, Floats], step: int, count: int) -> Belief:
    """Where the target may be if nothing is known, state (1, s) and covariance (1, s, s), in a step, for each agent."""
    wide = Belief(*search)
    for _ in range(step):
        wide = Belief(*predict(motion, wide))
    return Belief(np.repeat(wide.state, count, axis=0), np.repeat(wide.known_covariance, count, axis=0))
