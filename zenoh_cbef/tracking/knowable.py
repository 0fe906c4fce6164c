"""How certain an honest agent can be at most."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.linalg import inverse
from zenoh_cbef.tracking.motion import LinearMotion

_STEPS = 300
"""After so many steps what is known hardly changes any more."""


def most_information(motion: LinearMotion, initial: Floats, precision: float, axes: int) -> Floats:
    """An information matrix (s, s) that no network exceeds whose ranges have a precision in all, 1/m^2, in each step.

        O_0 = P_0^-1 + R,  O_k = (A O_{k-1}^-1 A^T + Q)^-1 + R,  R = precision on each axis of the position

    A range informs of one direction, here of all axes alike. The result is O_0 + O_300: what an agent begins with, or
    what the motion leaves it in the long run, whichever is more. initial: P_0, (s, s).
    """
    gained = np.diag(np.repeat([precision, 0.0], [axes, motion.size - axes]))
    first = latest = inverse(initial[None]) + gained
    for _ in range(_STEPS):
        predicted = motion.transition @ inverse(latest) @ motion.transition.T + motion.process_noise
        latest = inverse(predicted) + gained
    return np.asarray((first + latest)[0])
