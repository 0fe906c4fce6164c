"""How a recorded target moves, as far as its ranges tell, where the scenario leaves it open."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.datasets.agility import agility
from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.speed import speed
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.motion import RECORDED_ACCELERATION

_POWER = 0.1
"""The least power of its acceleration, m^2/s^3: of a person who changes velocity by 1 m/s once in ten seconds."""

_LEAST, _WALK = 0.5 * RECORDED_ACCELERATION, 1.0
"""The least acceleration, m/s^2, of a target that is as fast as a person who walks, m/s, by rules up to the 23rd."""

_SOONEST = 1e-3
"""Within what time a velocity is forgotten at the soonest, s."""

_DOUBT = 2.0
"""By what factor a noise that is told may be too small."""


def recorded_motion(scenario: Scenario, plain: Dataset) -> dict[str, float]:
    """Keys of [filter] that the ranges of a target tell. plain: these, without such as are far off.

    A velocity of standard deviation s that is forgotten within T is pushed with the power 2 s^2/T of accelerations. How
    fast ranges change tells s, how they turn tells the power, and so both tell T. No target counts for calmer than one
    that forgets its velocity within `velocity_time`; by the 23rd rules, nor than half of a person who walks as slowly
    and turns between any two ranges, however rare these are. A power without T, as by the rules before them, would let
    a person who turns on the spot run away in a silence.
    """
    chosen, interval = scenario.filter, plain.interval
    told = agility(plain)
    # From the 23rd rules on; where ranges are too few to tell a speed, as before.
    fast = speed(plain, _DOUBT * _noise(scenario)) if chosen.defaults > 22 else None
    if not fast or interval is None:
        return {"acceleration_std": _acceleration(told, interval, defaults=chosen.defaults)}
    power = max((told or 0.0) ** 2 * interval, 2.0 * fast**2 / chosen.velocity_time)
    least = min(1.0, float(np.sqrt(2.0)) * fast / _WALK) * _LEAST if chosen.defaults < 24 else 0.0
    found = {"acceleration_std": max(float(np.sqrt(power / interval)), least)}
    if "velocity_time" not in chosen.model_fields_set:
        found["velocity_time"] = max(2.0 * fast**2 / power, _SOONEST)
    return found


def _noise(scenario: Scenario) -> float:
    """The noise of ranges that the scenario tells, m; infinite where it leaves that open."""
    told = scenario.filter.range_std
    if isinstance(told, float):
        return told
    return scenario.sensor.range_std if "range_std" in scenario.sensor.model_fields_set else np.inf


def _acceleration(told: float | None, interval: float | None, *, defaults: int) -> float:
    """The acceleration, m/s^2, of a target whose speed is not known, for an interval of its ranges, s.

    told: what ranges tell. One that seems calm may still turn, however rare its ranges are: as a person does now and
    then, and by half of a person's acceleration at least. By the fifteenth rules it was all of that, which is hasty if
    it lasts for a second.
    """
    if interval is None or defaults < 16:
        return max(RECORDED_ACCELERATION, told or 0.0)
    return max(float(np.sqrt(_POWER / interval)), _LEAST, told or 0.0)
