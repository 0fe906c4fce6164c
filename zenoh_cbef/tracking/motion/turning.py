"""What ranges tell of a target that turns, which keeps its speed while its heading is corrected."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.motion.base import Motion
from zenoh_cbef.tracking.motion.constants import moving_of
from zenoh_cbef.tracking.motion.turn import CoordinatedTurn

_KNOWN = 0.5
"""How well, in rad, a heading has to be known for ranges to correct it, and not two components of the velocity."""

_Gaussian = tuple[Floats, Floats]


def turns(motion: Motion) -> bool:
    """Whether ranges turn the velocity of such a target."""
    moving = moving_of(motion)
    return isinstance(moving, CoordinatedTurn) and moving.keeps_speed


def turned(motion: Motion, before: _Gaussian, after: _Gaussian) -> _Gaussian:
    """State (..., s) and covariance (..., s, s) after ranges, of which what moved the velocity aside turns it.

        v + w  ->  cos a (v + w),  a: between v and v + w         the covariance turns by a with it

    A filter moves the velocity v by w along a straight line, and leaves its covariance in the directions that it had. A
    correction aside then makes the target faster by |w|^2/(2 |v|), each time, and what is known of its speed becomes
    something that is known of its heading. In long steps that soon is more than a calm motion leaves open of its
    speed. So what ranges tell is taken for a turn and a change of speed, as by a filter of heading and speed
    (Gustafsson, Isaksson, Best choice of coordinate system for tracking coordinated turns, IEEE CDC 1996).

    before, after: what was believed without the ranges, and with them. A motion that does not turn, or does so by older
    rules, keeps the latter, and so does a target of which the heading is not known beforehand.
    """
    if not turns(motion):
        return after
    (state, covariance), (moved, spread) = before, after
    x, y = motion.axes, motion.axes + 1
    across = covariance[..., x, x] + covariance[..., y, y]
    speed = state[..., x] * state[..., x] + state[..., y] * state[..., y]
    dot = state[..., x] * moved[..., x] + state[..., y] * moved[..., y]
    cross = state[..., x] * moved[..., y] - state[..., y] * moved[..., x]
    known = (across < _KNOWN**2 * speed) & (dot > 0.0)
    length = np.sqrt(np.where(known, dot * dot + cross * cross, 1.0))
    cosine, sine = np.where(known, dot / length, 1.0), np.where(known, cross / length, 0.0)
    state, covariance = moved.copy(), spread.copy()
    state[..., x : y + 1] *= cosine[..., None]
    for rows in (covariance, covariance.swapaxes(-1, -2)):
        first, second = rows[..., x, :].copy(), rows[..., y, :].copy()
        rows[..., x, :] = cosine[..., None] * first - sine[..., None] * second
        rows[..., y, :] = sine[..., None] * first + cosine[..., None] * second
    return state, covariance
