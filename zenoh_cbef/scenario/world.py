"""The physical world of a scenario: where target and agents are, and what the agents' receivers hear.

The target process and the simulator emulate it; with real receivers it is not used.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zenoh_cbef import streams
from zenoh_cbef.arrays import Floats
from zenoh_cbef.courses import RECORDED, Course, CourseSettings, Order, kind_of
from zenoh_cbef.datasets import read_dataset
from zenoh_cbef.faults import measured_ranges
from zenoh_cbef.plugins import blaming
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.paths import agent_positions, step_times


@dataclass(frozen=True)
class World:
    """What happens in steps 1 to K; row k-1 is step k.

    time: (K,), s. truth: (K, 6), the target's state, NaN where it is not known. positions: (n, K, 3), the agents.
    emitted, arrived: (n, K), run time (s) at which a beacon left the target and reached an agent; NaN where none was
    heard.
    """

    time: Floats
    truth: Floats
    positions: Floats
    emitted: Floats
    arrived: Floats


def make_world(scenario: Scenario) -> World:
    """The world of one scenario."""
    time = step_times(scenario, scenario.length)
    positions = agent_positions(scenario)
    if scenario.target.motion == RECORDED:
        dataset = read_dataset(Path(scenario.target.path or ""))
        origin = dataset.origin(scenario.dt)
        truth = dataset.truth_at(origin + time)
        emitted, ranges = dataset.beacons(origin + time)
        emitted = emitted - origin
    else:
        truth = target_path(scenario)[1:]
        emitted, ranges = time, _sensed(scenario, np.linalg.norm(truth[None, :, :3] - positions, axis=2))
    speed = scenario.sensor.signal_speed
    ranges = measured_ranges(scenario.fault, ranges, seed=scenario.seed, time=time, signal_speed=speed)
    emitted = np.where(np.isfinite(ranges), emitted, np.nan)
    return World(time, truth, positions, emitted, emitted + ranges / speed)


def target_start(scenario: Scenario) -> Floats:
    """The target's true state at step 0, (6,). Not for recorded data."""
    return np.asarray(_states(scenario, np.zeros(1))[0])


def target_path(scenario: Scenario) -> Floats:
    """The target's true states at steps 0 to K, (K + 1, 6). Not for recorded data."""
    return _states(scenario, np.concatenate([np.zeros(1), step_times(scenario, scenario.length)]))


def _states(scenario: Scenario, time: Floats) -> Floats:
    """Raises UserError where a motion of another package does not give (t, 6), or gives no finite numbers."""
    with blaming(kind_of(scenario.target.motion), "states", "check_motion"):
        states = np.asarray(_course(scenario).states(time), dtype=np.float64)
        if states.shape != (expected := (len(time), 6)):
            raise TypeError(f"states() gives {states.shape}, not {expected}")
        if not np.isfinite(states).all():
            raise FloatingPointError(f"a state is not finite at {time[~np.isfinite(states).all(axis=1)][0]:g} s")
    return states


def _course(scenario: Scenario) -> Course:
    target = scenario.target
    settings = CourseSettings(
        seed=scenario.seed,
        dt=scenario.dt,
        position=target.position,
        velocity=target.velocity,
        acceleration_std=target.acceleration_std,
        waypoints=target.waypoints,
        speed=target.speed,
        radius=target.radius,
        period=target.period,
        orders=tuple(Order(one.to, one.since, np.inf if one.until is None else one.until) for one in target.orders),
        options=target.options or {},
    )
    return kind_of(target.motion).of(settings)


def _sensed(scenario: Scenario, distances: Floats) -> Floats:
    """Measured ranges for true distances (n, K), NaN where the receiver heard nothing."""
    sensor, count = scenario.sensor, len(distances)
    agents, steps = np.arange(count), np.arange(1, distances.shape[1] + 1)

    def key(purpose: str) -> streams.Keys:
        return streams.stream(scenario.seed, purpose, agents)[:, None]

    bias = np.array(sensor.bias) + sensor.bias_std * streams.normal(key("sensor bias")[:, 0], 0)
    ranges = distances + bias[:, None] + sensor.range_std * streams.normal(key("range noise"), steps)
    if sensor.outlier_probability > 0.0:
        hit = streams.uniform(key("outlier"), steps) < sensor.outlier_probability
        ranges += np.where(hit, sensor.outlier_scale * streams.exponential(key("outlier size"), steps), 0.0)
    ranges = np.maximum(ranges, 0.0)
    if sensor.dropout_probability > 0.0:
        ranges[streams.uniform(key("dropout"), steps) < sensor.dropout_probability] = np.nan
    if sensor.reach is not None:
        ranges[~(distances <= sensor.reach)] = np.nan
    return ranges
