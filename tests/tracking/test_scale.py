"""Ranges that are all too long by the same share: few agents estimate it, and rely on it where biases do not do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.tracking.filters import Belief, FilterSettings, make_filter, sharing_of
from zenoh_cbef.tracking.filters.base import Bias
from zenoh_cbef.tracking.filters.finding.knowing import Knowing
from zenoh_cbef.tracking.filters.models.joint_biases import JointBiases
from zenoh_cbef.tracking.joint import joint_centralized
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours

COUNT, STEPS, STD, DT = 4, 300, 0.3, 0.5
MOTION = NearlyConstantVelocity(DT, 0.5, 2)
SETTINGS = FilterSettings(
    motion=MOTION,
    space=Space(0.0),
    range_std=STD,
    xi=np.inf,
    network_size=COUNT,
    bias="estimate",
    common_bias_std=0.45,
    own_bias_std=0.05,
    told_biases=True,
    joint_biases=True,
    scale_std=0.05,
)
PLACES = np.array([[0.0, 0.0, 0.0], [60.0, 5.0, 0.0], [25.0, 28.0, 0.0], [10.0, 70.0, 0.0]])
ANGLE = 0.05 * np.arange(STEPS)
TRUTH = np.stack([30.0 + 25.0 * np.sin(ANGLE), 35.0 + 25.0 * np.sin(2.0 * ANGLE), 0.0 * ANGLE], axis=1)
DISTANCE = np.linalg.norm(TRUTH[:, None] - PLACES, axis=2)
INITIAL = Belief(np.array([[30.0, 35.0, 2.5, 5.0]]), np.diag([4.0, 4.0, 4.0, 4.0])[None])


def measured(share, bias):
    """Ranges (K, n) that are too long by a share and a length."""
    return (1.0 + share) * DISTANCE + bias + STD * np.random.default_rng(3).normal(size=DISTANCE.shape)


def averaged(chosen, ranges):
    """Beliefs of agents that learn the exact average."""
    belief = Belief(INITIAL.state.repeat(COUNT, axis=0), INITIAL.known_covariance.repeat(COUNT, axis=0))
    for row in ranges:
        update = chosen.update(
            belief, Measurement(PLACES, row, np.zeros(COUNT), *no_neighbours(COUNT), agent=np.arange(COUNT))
        )
        belief = chosen.conclude(np.repeat(update.payload.mean(axis=0)[None], COUNT, axis=0), update)
        yield belief


def off(beliefs):
    """Root mean square error of the last half, m."""
    states = np.stack([belief.state[0, :2] for belief in beliefs])
    return np.sqrt(np.mean(np.sum((states - TRUTH[: len(states), :2]) ** 2, axis=1)[STEPS // 2 :]))


def test_with_an_exact_average_it_is_the_centralised_filter_of_target_biases_and_share():
    mean, covariance = np.zeros(9), np.zeros((9, 9))
    mean[:4], covariance[:4, :4] = INITIAL.state[0], INITIAL.known_covariance[0]
    covariance[4:8, 4:8], covariance[8, 8] = 0.45**2 + 0.05**2 * np.eye(COUNT), 0.05**2
    step = np.eye(9)
    step[:4, :4] = MOTION.transition
    ranges = measured(0.07, 0.3)[:5]
    for row, belief in zip(ranges, averaged(JointBiases.of(SETTINGS, np.inf), ranges), strict=True):
        mean, covariance = step @ mean, step @ covariance @ step.T
        covariance[:4, :4] += MOTION.process_noise
        apart = mean[:2] - PLACES[:, :2]
        distance = np.linalg.norm(apart, axis=1)
        rows = np.concatenate([(1.0 + mean[8]) * apart / distance[:, None], np.zeros((4, 2)), np.eye(4)], axis=1)
        rows = np.column_stack([rows, distance])
        gain = covariance @ rows.T @ np.linalg.inv(rows @ covariance @ rows.T + STD**2 * np.eye(4))
        told = np.column_stack([np.zeros((4, 4)), np.eye(4), distance])
        mean = mean + gain @ (row - (1.0 + mean[8]) * distance - mean[4:8])
        covariance = covariance - gain @ rows @ covariance
        np.testing.assert_allclose(belief.memory[0][0], mean, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(belief.memory[1][0], covariance, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(belief.bias.value, told @ mean, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(belief.bias.std, np.sqrt(np.diag(told @ covariance @ told.T)), rtol=1e-5)


@pytest.mark.parametrize("bias", ["estimate", "auto"])
def test_agents_find_the_share_where_ranges_have_one(bias):
    settings, ranges = replace(SETTINGS, bias=bias), measured(0.07, 0.0)
    with_share = list(averaged(make_filter("icf", settings), ranges))
    without = averaged(make_filter("icf", replace(settings, scale_std=0.0)), ranges)
    assert off(with_share) < 0.4 * off(without)
    np.testing.assert_allclose(with_share[-1].bias.value, 0.07 * DISTANCE[-1], atol=0.5)
    assert sharing_of("icf", settings).payload_size == make_filter("icf", settings).update(
        Belief(INITIAL.state, INITIAL.covariance),
        Measurement(PLACES[:1], ranges[0, :1], np.zeros(1), *no_neighbours(1), agent=np.arange(1)),
    ).payload.shape[1]  # fmt: skip


def test_where_ranges_have_none_biases_are_estimated_as_without_it():
    ranges = measured(0.0, 0.5)
    with_share = off(averaged(make_filter("icf", SETTINGS), ranges))
    assert with_share == pytest.approx(
        off(averaged(make_filter("icf", replace(SETTINGS, scale_std=0.0)), ranges)), 0.02
    )


@pytest.mark.parametrize("bias", ["estimate", "auto"])
def test_the_centralised_yardstick_does_the_same(bias):
    settings, ranges = replace(SETTINGS, bias=bias, likelihoods=True), measured(0.07, 0.0)[:60]
    positions = np.repeat(PLACES[None, :, None], len(ranges), axis=2)
    states, covariances = joint_centralized(
        INITIAL, settings, np.inf, positions=positions, ranges=ranges.T[None], age=np.zeros((1, *ranges.T.shape))
    )
    network = list(averaged(make_filter("icf", settings), ranges))
    np.testing.assert_allclose(states[0][:, [0, 1, 3, 4]], [belief.state[0] for belief in network], atol=1e-6)
    found = covariances[0][:, [0, 1, 3, 4]][:, :, [0, 1, 3, 4]]
    np.testing.assert_allclose(found, [belief.known_covariance[0] for belief in network], rtol=1e-5, atol=1e-9)


def test_a_bias_that_grows_with_the_distance_is_no_sign_of_a_wrong_estimate():
    far = Measurement(PLACES[1:2], np.full(1, 90.0), np.zeros(1), *no_neighbours(1))
    state = np.array([[-30.0, 5.0, 0.0, 0.0]])  # 90 m away
    for value, share, strange in ((6.0, 0.05, False), (6.0, 0.0, True), (25.0, 0.05, True)):
        known = Knowing(make_filter("icf", SETTINGS), replace(SETTINGS, scale_std=share))
        bias = Bias.constant(np.full(1, value), np.ones(1))
        assert known._explains_nothing(bias, state, far)[0] == strange  # noqa: SLF001


def test_a_bias_with_a_share_is_taken_off_where_a_range_is_and_not_where_it_was_estimated():
    """Ranges that are 0.3 m and a tenth too long, of a bias that was estimated at 20 m."""
    distance, truth = np.array([20.0, 20.0]), np.array([5.0, 80.0])
    value, none = 0.3 + 0.1 * distance, np.zeros(2)
    relied_on = Bias(value, none, np.ones(2), np.full(2, 0.1))
    np.testing.assert_allclose(relied_on.taken_off(0.3 + 1.1 * truth, distance), truth)
    np.testing.assert_array_equal(Bias(value, none, none, relied_on.share).taken_off(truth, distance), truth)
    np.testing.assert_array_equal(Bias.constant(value, none).taken_off(truth, distance), truth - value)
