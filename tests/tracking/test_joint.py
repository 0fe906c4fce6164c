"""The centralised filter with the network's options is a network whose agents average exactly."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from zenoh_cbef.tracking.filters import FilterSettings, make_filter
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.joint import joint_centralized
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours

RUNS, STEPS, DT, STD, XI = 2, 60, 0.2, 0.1, 1.5
CALM, WILD = NearlyConstantVelocity(DT, 0.3), NearlyConstantVelocity(DT, 20.0)
AUTO = {"bias": "auto", "common_bias_std": 0.5, "own_bias_std": 0.4}


def scene(agents, bias):
    """Agents that move, with ranges of which some are missing or far too long, to a target that goes round."""
    random = np.random.default_rng(7)
    angle = 0.15 * np.arange(STEPS)
    truth = np.stack([3.0 * np.cos(angle), 3.0 * np.sin(angle), 0.5 * np.cos(2.0 * angle)], axis=1)
    drift = np.cumsum(random.normal(scale=0.3, size=(RUNS, agents, STEPS, 3)), axis=2)
    positions = random.uniform(-8.0, 8.0, (RUNS, agents, 1, 3)) + drift
    age = random.uniform(0.0, 0.1, (RUNS, agents, STEPS))
    ranges = np.linalg.norm(truth - positions, axis=3) + bias + 2.0 * STD * random.normal(size=age.shape)
    ranges[random.random(age.shape) < 0.05] += 5.0
    ranges[random.random(age.shape) < 0.1] = np.nan
    initial = Belief(
        np.array([[2.0, 1.0, 0.3, 0.0, 0.4, 0.0]]).repeat(RUNS, axis=0), np.diag([1.0] * 6)[None].repeat(RUNS, axis=0)
    )
    return initial, positions, ranges, np.where(np.isfinite(ranges), age, np.nan)


def averaged(chosen, initial, positions, ranges, age):
    """What the agents of each run estimate, when every one learns the exact average of all payloads in every step."""
    states, covariances = np.empty((RUNS, STEPS, 6)), np.empty((RUNS, STEPS, 6, 6))
    agents = ranges.shape[1]
    for run in range(RUNS):
        filter_ = make_filter("sicf", chosen)
        belief = Belief(initial.state[[run] * agents], initial.known_covariance[[run] * agents])
        for k in range(STEPS):
            heard = np.nan_to_num(age[run, :, k])
            update = filter_.update(
                belief, Measurement(positions[run, :, k], ranges[run, :, k], heard, *no_neighbours(agents))
            )
            belief = filter_.conclude(update.payload.mean(axis=0)[None].repeat(agents, axis=0), update)
            states[run, k], covariances[run, k] = belief.state[0], belief.known_covariance[0]
    return states, covariances


@pytest.mark.parametrize(
    ("agents", "more"),
    [
        (5, {"learns_noise": True}),
        (5, {"first_fix": 6, "squared_fix": 3}),
        (5, {"first_fix": 6, "learns_noise": True}),
        (5, {"power": 2, "models": (CALM, WILD), "leaving": (0.1,)}),
        (5, {"models": (CALM, WILD), "leaving": (0.1,), "learns_noise": True, "first_fix": 4}),
        # Of one agent's bias the network's filter is the joint one: it leaves out correlations between agents alone.
        (1, {**AUTO, "bias": "estimate", "learns_noise": True}),
        (1, AUTO),
        (1, {**AUTO, "learns_noise": True}),
        (1, {**AUTO, "likelihoods": False, "first_fix": 4}),
    ],
)
def test_the_centralised_filter_is_a_network_that_averages_exactly(agents, more):
    chosen = FilterSettings(CALM, Space(), STD, XI, agents, **more)
    initial, positions, ranges, age = scene(agents, 0.8 if "bias" in more else 0.0)
    found = joint_centralized(initial, chosen, XI, positions=positions, ranges=ranges, age=age)
    expected = averaged(chosen, initial, positions, ranges, age)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)


def test_several_motions_that_are_one_leave_the_filter_with_biases_as_it_is():
    biases: dict[str, Any] = {"bias": "estimate", "own_bias_std": 0.8, "joint_biases": True, "told_biases": True}
    one = FilterSettings(CALM, Space(), STD, XI, 5, **biases)
    initial, positions, ranges, age = scene(5, 0.8)
    found, expected = (
        joint_centralized(initial, each, XI, positions=positions, ranges=ranges, age=age)
        for each in (replace(one, models=(CALM, CALM), leaving=(0.1,)), one)
    )
    for several, single in zip(found, expected, strict=True):
        np.testing.assert_allclose(several, single, rtol=1e-6, atol=1e-6)


def test_of_an_agent_that_is_not_there_no_position_is_needed():
    initial, positions, ranges, age = scene(4, 0.0)
    ranges[:, 3] = age[:, 3] = np.nan
    chosen = FilterSettings(CALM, Space(), STD, XI, 4, first_fix=6, learns_noise=True)
    known = joint_centralized(initial, chosen, XI, positions=positions, ranges=ranges, age=age)
    lost = np.array(positions)
    lost[:, 3, :6] = np.nan
    for one, other in zip(
        known, joint_centralized(initial, chosen, XI, positions=lost, ranges=ranges, age=age), strict=True
    ):
        np.testing.assert_array_equal(one, other)
