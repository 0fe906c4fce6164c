"""What the filter assumes of the target's motion, where the scenario leaves it open."""

from __future__ import annotations

from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.tracking.motion import LinearMotion, Motion, MotionSettings, NearlyConstantVelocity, make_motion

_RECORDED_ACCELERATION = 1.0
"""Acceleration of a real target where the scenario gives none, m/s^2: a walking person, a trolley, a slow vehicle."""

_INDEX = 0.3
"""Tracking index q dt^2/sigma (Kalata, IEEE TAES 20(2), 1984) of a target of which nothing else is known.

Below it a filter averages over many steps, and lags where the target turns; above it the filter hardly averages.
"""


def assumed_motion(scenario: Scenario, range_std: float, axes: int) -> Motion:
    """The filter's model. range_std: m, what the filter assumes. axes: 3, or 2 in a plane."""
    chosen = scenario.filter.motion
    return make_motion("ncv" if chosen == "auto" else chosen, _settings(scenario, range_std, axes))


def plain_motion(scenario: Scenario, range_std: float, axes: int) -> LinearMotion:
    """The filter's model if it is linear in position and velocity and has no other state, otherwise ncv."""
    motion = assumed_motion(scenario, range_std, axes)
    if isinstance(motion, LinearMotion) and not motion.extra_std:
        return motion
    return NearlyConstantVelocity.of(_settings(scenario, range_std, axes))


def _settings(scenario: Scenario, range_std: float, axes: int) -> MotionSettings:
    chosen = scenario.filter
    return MotionSettings(
        dt=scenario.dt,
        acceleration_std=_acceleration_std(scenario, range_std),
        axes=axes,
        interval=chosen.acceleration_interval,
        velocity_time=chosen.velocity_time,
        turn_rate_std=chosen.turn_rate_std,
    )


def _acceleration_std(scenario: Scenario, range_std: float) -> float:
    """The filter's q: given, or of a key that describes this very motion, or from noise and step."""
    target, given = scenario.target, scenario.filter.acceleration_std
    if given is not None:
        return given
    if target.motion == "ncv" or (scenario.filter.defaults == 1 and target.motion != "dataset"):
        return target.acceleration_std
    return _RECORDED_ACCELERATION if target.motion == "dataset" else _INDEX * range_std / scenario.dt**2
