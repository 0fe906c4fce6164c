"""What agents know of the target before the first step, and whether they have to look for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef import streams
from zenoh_cbef.faults import SenderFault
from zenoh_cbef.scenario import paths
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.world import target_start
from zenoh_cbef.tracking.filters import Belief, abilities_of
from zenoh_cbef.tracking.ranging import Space

Floats = NDArray[np.float64]

_FARTHEST = 10.0
"""Where a first fix looks for the target: least standard deviation in half diagonals of the box around the agents."""

_FASTEST = 3.0
"""Least standard deviation of the target's velocity before the first fix, m/s."""


def space_of(scenario: Scenario) -> Space:
    """Three axes, or the plane at filter.planar_height."""
    return Space(scenario.filter.planar_height)


def distrusts(scenario: Scenario) -> bool:
    """Whether neighbours may send wrong values: what is then compared and trimmed is one filter's information."""
    return scenario.consensus.trim > 0 or any(isinstance(fault, SenderFault) for fault in scenario.fault)


def initial_std(scenario: Scenario) -> Floats:
    """Standard deviations of the initial estimate, (6,): m, then m/s."""
    position, velocity = scenario.filter.initial_position_std, scenario.filter.initial_velocity_std
    if position is None and scenario.target.motion == "dataset":
        position = _half_diagonal(scenario) or None
    return np.repeat([position or 1.0, velocity or 1.0], 3)


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


def initial_covariance(scenario: Scenario) -> Floats:
    """Covariance of the initial estimate along the estimated axes, (s, s). Before a first fix it is wide."""
    std = initial_std(scenario)
    if _seeks(scenario):
        std = np.maximum(std, np.repeat([_FARTHEST * _half_diagonal(scenario), _FASTEST], 3))
    return np.asarray(np.diag(std[space_of(scenario).kept] ** 2))


def initial_belief(scenario: Scenario) -> Belief:
    """The agents' initial estimates along the estimated axes: states (n, s), covariances (n, s, s)."""
    kept, covariance = space_of(scenario).kept, initial_covariance(scenario)
    return Belief(initial_states(scenario)[:, kept], np.broadcast_to(covariance, (scenario.count, *covariance.shape)))


def first_fix_steps(scenario: Scenario) -> int:
    """How many steps the first fix takes, one for every iteration; 0 for none."""
    return settling_steps(scenario) if _seeks(scenario) else 0


def settling_steps(scenario: Scenario) -> int:
    """In how many steps a network knows where its target is: at least 20, and about five ranges of every agent."""
    interval = scenario.filter.acceleration_interval or scenario.dt
    return max(20, int(np.ceil(5.0 * interval / scenario.dt)))


def _seeks(scenario: Scenario) -> bool:
    """Whether nothing is known of a recorded target's start, so that the network begins with a first fix."""
    chosen = scenario.filter
    unknown = scenario.target.motion == "dataset" and chosen.initial_position is None
    return unknown and abilities_of(chosen.kind).biases and not distrusts(scenario)
