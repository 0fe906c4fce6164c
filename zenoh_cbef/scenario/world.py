"""The physical world of a scenario: where target and agents are, and what the agents' receivers hear.

The target process and the simulator emulate it; with real receivers it is not used.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zenoh_cbef import streams
from zenoh_cbef.arrays import Floats
from zenoh_cbef.datasets import read_dataset
from zenoh_cbef.faults import measured_ranges
from zenoh_cbef.scenario.model import Scenario, Target
from zenoh_cbef.scenario.paths import agent_positions, along, step_times


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
    if scenario.target.motion == "dataset":
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
    target = scenario.target
    if target.motion == "ncv":
        return np.array([*target.position, *target.velocity])
    if target.motion == "manual":
        return np.array([*target.position, 0.0, 0.0, 0.0])
    return np.asarray(_prescribed(target, np.zeros(1))[0], dtype=np.float64)


def target_path(scenario: Scenario) -> Floats:
    """The target's true states at steps 0 to K, (K + 1, 6). Not for recorded data."""
    target, steps, dt = scenario.target, scenario.length, scenario.dt
    if target.motion != "ncv":
        times = np.concatenate([np.zeros(1), step_times(scenario, steps)])
        return _steered(target, times, dt) if target.motion == "manual" else _prescribed(target, times)
    key = streams.stream(scenario.seed, "acceleration", np.arange(3))
    acceleration = target.acceleration_std * streams.normal(key, np.arange(steps)[:, None])
    state = np.empty((steps + 1, 6))
    state[0] = target_start(scenario)
    state[1:, 3:] = dt * acceleration
    state[:, 3:] = np.cumsum(state[:, 3:], axis=0)
    state[1:, :3] = dt * state[:-1, 3:] + 0.5 * dt**2 * acceleration
    state[:, :3] = np.cumsum(state[:, :3], axis=0)
    return state


def _prescribed(target: Target, time: Floats) -> Floats:
    if target.motion == "waypoints":
        return along(np.array(target.waypoints), target.speed, time)
    rate = 2.0 * np.pi / target.period
    sine, cosine = np.sin(rate * time), np.cos(rate * time)
    state = np.zeros((len(time), 6))
    if target.motion == "circle":
        state[:, 0], state[:, 1] = cosine, sine
        state[:, 3], state[:, 4] = -rate * sine, rate * cosine
    else:  # the lemniscate of Gerono
        state[:, 0], state[:, 1] = sine, sine * cosine
        state[:, 3], state[:, 4] = rate * cosine, rate * (cosine**2 - sine**2)
    state *= target.radius
    state[:, :3] += np.array(target.position)
    return state


def _steered(target: Target, times: Floats, dt: float) -> Floats:
    """States (K + 1, 6) of a target that goes straight to where its orders say, at its speed, and rests there.

    Of several orders that are on the last one holds. What an order changes comes after it, so one more changes no past.
    """
    chosen = np.full(len(times), -1)
    for number, order in enumerate(target.orders):
        chosen[(times >= order.since) & (times < (np.inf if order.until is None else order.until))] = number
    state = np.zeros((len(times), 6))
    state[0, :3] = target.position
    begins = [1, *(np.flatnonzero(np.diff(chosen[1:])) + 2).tolist()]
    for first, last in zip(begins, [*begins[1:], len(times)], strict=True):
        if first >= last:
            continue
        start = state[first - 1, :3]
        gap = (np.array(target.orders[chosen[first]].to) if chosen[first] >= 0 else start) - start
        away = max(float(np.linalg.norm(gap)), 1e-12)
        share = np.minimum(np.arange(1, last - first + 1) * (target.speed * dt / away), 1.0)
        state[first:last, :3] = start + share[:, None] * gap
    state[1:, 3:] = np.diff(state[:, :3], axis=0) / dt
    return state


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
    heard = streams.uniform(key("dropout"), steps) >= sensor.dropout_probability
    return np.where(heard, ranges, np.nan)
