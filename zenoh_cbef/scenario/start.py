"""The agents' estimates of the target before the first step, and their standard deviations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef import streams
from zenoh_cbef.scenario import paths
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.world import target_start

Floats = NDArray[np.float64]

_FARTHEST = 10.0
"""Where a first fix looks for the target: least standard deviation in half diagonals of the box around the agents."""

_FASTEST = 3.0
"""Least standard deviation of the target's velocity before the first fix, m/s."""


def initial_std(scenario: Scenario) -> Floats:
    """Standard deviations of the initial estimate, (6,): m, then m/s."""
    position, velocity = scenario.filter.initial_position_std, scenario.filter.initial_velocity_std
    if position is None and scenario.target.motion == "dataset":
        position = _half_diagonal(scenario) or None
    return np.repeat([position or 1.0, velocity or 1.0], 3)


def widened_std(scenario: Scenario) -> Floats:
    """As initial_std, where the network looks for its target by a first fix, (6,)."""
    least = np.repeat([_FARTHEST * _half_diagonal(scenario), _FASTEST], 3)
    return np.asarray(np.maximum(initial_std(scenario), least))


def _half_diagonal(scenario: Scenario) -> float:
    return float(np.linalg.norm(np.ptp(paths.placement(scenario), axis=0))) / 2.0


def initial_states(scenario: Scenario) -> Floats:
    """The agents' estimates before step 1, as configured, (n, 6).

    A given position or velocity is taken as it is. What is not given is drawn around the target's own start with
    the initial standard deviations; for recorded data it is the middle of the agents, at rest.
    """
    count, chosen = scenario.count, scenario.filter
    if scenario.target.motion == "dataset":
        derived = np.zeros((count, 6))
        derived[:, :3] = paths.placement(scenario).mean(axis=0)
    else:
        key = streams.stream(scenario.seed, "initial estimate", np.arange(count))[:, None]
        noise = np.concatenate([streams.normal(key, axis) for axis in range(6)], axis=1)
        derived = target_start(scenario) + initial_std(scenario) * noise
    if chosen.initial_position is not None:
        derived[:, :3] = np.array(chosen.initial_position)
    if chosen.initial_velocity is not None:
        derived[:, 3:] = np.array(chosen.initial_velocity)
    if chosen.planar_height is not None:
        derived[:, 2], derived[:, 5] = chosen.planar_height, 0.0
    return derived
