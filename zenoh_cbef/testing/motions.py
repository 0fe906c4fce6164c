"""What every motion of a target must hold to: `check_motion(Mine)`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.courses.base import Course, CourseSettings, course_of
from zenoh_cbef.plugins import told_options
from zenoh_cbef.testing.nonconforming import Nonconforming, only_reading

_STEPS, _DT = 400, 0.05
_SLACK = 0.05
"""How far a step may differ from its velocities, in units of the longest step. A way may have corners, in half of all
steps at most."""

_SETTINGS = CourseSettings(
    seed=1,
    dt=_DT,
    position=(1.0, -2.0, 0.5),
    velocity=(1.0, 0.5, 0.0),
    acceleration_std=0.1,
    waypoints=((0.0, 0.0, 0.0), (9.0, 4.0, 2.0)),
    speed=1.0,
    radius=5.0,
    period=30.0,
    orders=(),
    options={},
)


def check_motion(kind: type, **options: object) -> None:
    """Ask of a motion all that runs rely on.

    Raises Nonconforming, or ValueError for options that the motion has not, or a class that is no motion.
    kind: the class that `target.motion` would name. options: as in `target.options`. The motion goes through 400 steps
    with each of two seeds.
    """
    chosen = course_of(kind, kind.__qualname__)
    told = told_options(getattr(chosen, "options", None), kind.__qualname__, options, "target.options")
    for seed in (1, 2):
        _check(chosen, replace(_SETTINGS, seed=seed, options=told))


def _check(kind: type[Course], settings: CourseSettings) -> None:
    time = _DT * np.arange(_STEPS + 1, dtype=np.float64)
    time.flags.writeable = False
    one = kind.of(settings)
    states = _states(one, time)
    if _states(one, time).tobytes() != states.tobytes():
        raise Nonconforming("the same motion gives other states the second time; keep nothing between two calls")
    if _states(kind.of(settings), time).tobytes() != states.tobytes():
        raise Nonconforming(
            "two motions of the same settings give different states; draw from stream(settings.seed, ...), and ask no "
            "clock"
        )
    for steps in (0, 1, _STEPS // 2):
        if _states(one, time[: steps + 1]).tobytes() != states[: steps + 1].tobytes():
            raise Nonconforming(
                f"the first {steps} steps of a longer run differ from those of a run of {steps} steps; let a state "
                "depend on its own time and earlier ones alone"
            )
    _check_velocities(states)


def _states(one: Course, time: Floats) -> Floats:
    with only_reading("states()", "times"):
        states = one.states(time)
    expected = len(time), 6
    if not isinstance(states, np.ndarray) or states.dtype != np.float64 or states.shape != expected:
        found = f"{states.dtype} {states.shape}" if isinstance(states, np.ndarray) else type(states).__name__
        raise Nonconforming(f"states() gives {found}, not float64 {expected}: a position and a velocity for each time")
    if not np.isfinite(states).all():
        raise Nonconforming("a state is not finite; correct states()")
    return states


def _check_velocities(states: Floats) -> None:
    """Velocities must be those of the positions: errors and NEES of velocities are told by them."""
    moved = np.diff(states[:, :3], axis=0)
    told = 0.5 * _DT * (states[1:, 3:] + states[:-1, 3:])
    off = np.linalg.norm(moved - told, axis=1)
    longest = max(np.linalg.norm(moved, axis=1).max(), np.linalg.norm(told, axis=1).max())
    if np.median(off) > _SLACK * longest:
        raise Nonconforming(
            "the velocities are not those of the positions: over a step they lead elsewhere; give metres per second"
        )
