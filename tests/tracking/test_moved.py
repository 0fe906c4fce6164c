"""What a filter knows of biases stays when its belief is moved to another place, or widened."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.filtering import Filtering
from zenoh_cbef.scenario.load import load
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters import FilterSettings
from zenoh_cbef.tracking.filters.base import Belief, Bias
from zenoh_cbef.tracking.filters.models.biased_information import BiasedInformation
from zenoh_cbef.tracking.filters.models.joint_biases import JointBiases
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Space

MOTION = NearlyConstantVelocity(0.1, 0.5)
FILTER = BiasedInformation(MOTION, Space(), 0.1, 4, 0.5, 0.4)


def memory():
    """Of two agents: state and covariance of (p, v, c), the own bias and its variance, and their covariances."""
    random = np.random.default_rng(3)
    root = random.normal(size=(2, 7, 7))
    return random.normal(size=(2, 7)), root @ root.swapaxes(1, 2), *random.normal(size=(2, 2)), root[:, 0]


def test_another_place_owes_nothing_to_biases_and_leaves_them_as_they_are():
    before, place = memory(), Belief(np.arange(12.0).reshape(2, 6), np.stack([np.eye(6), 4.0 * np.eye(6)]))
    state, covariance, own, variance, cross = FILTER.moved(before, place)
    np.testing.assert_array_equal(state[:, :6], place.state)
    np.testing.assert_array_equal(covariance[:, :6, :6], place.known_covariance)
    np.testing.assert_array_equal(state[:, 6], before[0][:, 6])
    np.testing.assert_array_equal(covariance[:, 6, 6], before[1][:, 6, 6])
    assert not covariance[:, 6, :6].any()
    assert not covariance[:, :6, 6].any()
    np.testing.assert_array_equal([own, variance, cross[:, 6]], [before[2], before[3], before[4][:, 6]])
    assert not cross[:, :6].any()
    # What was handed over is as it was.
    for kept, once in zip(before, memory(), strict=True):
        np.testing.assert_array_equal(kept, once)


def test_another_place_forgets_biases_that_are_beyond_belief():
    before, place = memory(), Belief(np.zeros((2, 6)), np.tile(np.eye(6), (2, 1, 1)))
    before[0][:, 6], before[2][:] = [1.5, -2.0], [0.4, -0.6]
    chosen = replace(FILTER, most=2.5)
    state, covariance, own, variance, cross = chosen.moved(before, place)
    assert state[:, 6].tolist() == [1.5, 0.0]
    assert own.tolist() == [0.4, 0.0]
    np.testing.assert_array_equal(covariance[:, 6, 6], [before[1][0, 6, 6], 0.5**2])
    np.testing.assert_array_equal(variance, [before[3][0], 0.4**2])
    np.testing.assert_array_equal(cross[:, 6], [before[4][0, 6], 0.0])


def test_so_do_agents_that_estimate_all_together():
    settings = FilterSettings(MOTION, Space(), 0.1, 2.0, 2, common_bias_std=0.5, own_bias_std=0.4, scale_std=0.05)
    chosen = replace(JointBiases.of(settings, 2.0), most=2.5)
    random = np.random.default_rng(5)
    root = random.normal(size=(2, 9, 9))
    before = random.normal(size=(2, 9)), root @ root.swapaxes(1, 2), np.zeros(2)
    before[0][:, 6:] = [[2.0, -2.4, 0.1], [0.3, 2.6, 0.2]]
    place = Belief(np.zeros((2, 6)), np.tile(np.eye(6), (2, 1, 1)))
    state, covariance, begins = chosen.moved(before, place)
    assert state[:, 6:].tolist() == [[2.0, -2.4, 0.1], [0.0] * 3]
    np.testing.assert_array_equal(covariance[0, 6:, 6:], before[1][0, 6:, 6:])
    np.testing.assert_allclose(covariance[1, 6:, 6:], [[0.41, 0.25, 0], [0.25, 0.41, 0], [0, 0, 0.0025]])
    assert not covariance[:, :6, 6:].any()
    assert not begins.any()


def test_only_biases_of_real_ranges_are_beyond_belief():
    for keys, most in (
        (("lawnmower",), 4.0 * np.linalg.norm([1.5 * 1.5, 0.2 * 1.5, 0.05 * 47.6135])),
        (("lawnmower", "filter.defaults=28"), np.inf),
        (("tracking", "sensor.bias_std=1"), np.inf),
    ):
        assert Filtering(load(keys[0], keys[1:]).scenario).settings.most_bias == pytest.approx(most)


def test_a_fix_takes_no_bias_off_ranges_that_is_beyond_belief():
    bias = Bias(np.array([1.0, 3.0, -3.0]), np.ones(3), np.array([1.0, 1.0, 0.5]), np.array([0.1, 0.0, 0.0]))
    ranges, distance = np.array([12.0, 12.0, 12.0]), np.array([5.0, 5.0, 5.0])
    np.testing.assert_allclose(bias.taken_off(ranges, distance), [11.5 / 1.1, 9.0, 13.5])
    np.testing.assert_allclose(bias.taken_off(ranges, distance, 2.5), [11.5 / 1.1, 12.0, 12.0])


def test_a_belief_is_widened_in_all_but_biases():
    before, factor = memory(), np.array([4.0, 9.0])
    state, covariance, own, variance, cross = FILTER.widened(before, factor)
    for now, once in ((state, before[0]), (own, before[2]), (variance, before[3])):
        np.testing.assert_array_equal(now, once)
    scale = np.ones((2, 7))
    scale[:, :6] = np.sqrt(factor)[:, None]
    np.testing.assert_allclose(covariance, before[1] * scale[:, :, None] * scale[:, None])
    np.testing.assert_allclose(cross, before[4] * scale)


def test_an_agent_alone_has_no_biases_to_share():
    alone, two = (JointBiases.sharing(FilterSettings(MOTION, Space(), 0.1, 2.0, count)) for count in (1, 2))
    assert (alone.cooperates, two.cooperates) == (False, True)
