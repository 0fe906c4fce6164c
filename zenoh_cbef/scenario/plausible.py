"""What beacon times say, and which ranges the receivers of a scenario can measure at all: agents ignore all others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.courses import RECORDED
from zenoh_cbef.faults import SensorFault
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.paths import placement
from zenoh_cbef.scenario.trust import zero_is_none
from zenoh_cbef.scenario.world import target_path

Real = TypeVar("Real", float, Floats)

FACTOR = 1000.0
"""How far beyond what the scenario allows for a range may be. No outlier of an emulated receiver comes near it."""

_ROUNDING = 4.0 * float(np.finfo(np.float64).eps)


def taken(scenario: Scenario, emitted: Real, arrived: Real, step: int | Real) -> tuple[Real, Real]:
    """Range (m) and age (s) that agents take from beacon times, s: floats or arrays, plausible or not.

    The one place with this arithmetic, for processes and simulator alike. step counts from 1.
    """
    return scenario.sensor.signal_speed * (arrived - emitted), step * scenario.dt - emitted


@dataclass(frozen=True)
class Plausible:
    """Least and largest range, m, and the largest age of a beacon, before or after its step, s.

    zero: whether a range of zero is one, and tells how far the target is.
    """

    least: float
    largest: float
    age: float
    zero: bool = True

    def holds(self, ranges: Real, age: Real) -> Bools | bool:
        """Which ranges (m) of which ages (s) are plausible; NaN is not."""
        return (ranges >= self.least) & (ranges <= self.largest) & (abs(age) <= self.age)

    def tells(self, ranges: Real) -> Bools | bool:
        """Which ranges (m) tell how far the target is."""
        return (abs(ranges) > 0.0) | self.zero


def plausible_ranges(scenario: Scenario) -> Plausible:
    """The limits of ranges that a receiver of the scenario can measure, with a wide margin.

    largest: 1000 times the sum of how far apart agents, target and initial estimates can be at first, of how far they
    can go in the run's time, and of all errors of receivers. least: minus 1000 times these errors.
    """
    duration = scenario.length * scenario.dt
    errors = _errors(scenario)
    rounding = _ROUNDING * scenario.sensor.signal_speed * (duration + 1.0)
    return Plausible(
        -FACTOR * (errors + rounding),
        FACTOR * (_apart(scenario) + _travel(scenario, duration) + errors + rounding + 1.0),
        duration + FACTOR * scenario.dt,
        zero=not zero_is_none(scenario),
    )


def _apart(scenario: Scenario) -> float:
    """How far agents, target and initial estimates can be from each other at the start, or where they are sent, m."""
    agents, target, chosen = scenario.agents, scenario.target, scenario.filter
    places = [placement(scenario), *(np.array(points) for points in agents.waypoints)]
    if target.motion == "waypoints":
        places.append(np.array(target.waypoints))
    elif target.plugin is not None:
        places.append(target_path(scenario)[:, :3])
    elif target.motion != RECORDED:
        places.append(np.array([target.position]))
    if chosen.initial_position is not None:
        places.append(np.array(chosen.initial_position).reshape(-1, 3))
    box = float(np.ptp(np.concatenate(places), axis=0).sum())
    return 10.0 * (box + target.radius + (chosen.initial_position_std or 0.0) + abs(chosen.planar_height or 0.0))


def _travel(scenario: Scenario, duration: float) -> float:
    """How far target and agents can go in a run, m: also with the speeds that the filter takes to be possible."""
    agents, target, chosen = scenario.agents, scenario.target, scenario.filter
    speeds = [*agents.velocity, *target.velocity, chosen.initial_velocity_std or 1.0, agents.speed, target.speed]
    if chosen.initial_velocity is not None:
        speeds += np.abs(np.array(chosen.initial_velocity)).ravel().tolist()
    walk = max(target.acceleration_std, chosen.acceleration_std or 0.0) * float(np.sqrt(duration * scenario.dt))
    return 10.0 * duration * (float(np.abs(speeds).sum()) + walk)


def _errors(scenario: Scenario) -> float:
    """How wrong receivers can be, m; infinite with faults whose errors are unknown."""
    sensor, assumed = scenario.sensor, scenario.filter.range_std
    told = assumed if isinstance(assumed, float) else 0.0
    outliers = sensor.outlier_scale if sensor.outlier_probability > 0.0 else 0.0
    bias = float(np.abs(np.array(sensor.bias)).max()) + sensor.bias_std
    faults = [fault for fault in scenario.fault if isinstance(fault, SensorFault)]
    return max(sensor.range_std, told) + bias + outliers + sum(fault.error for fault in faults)
