"""What ranges say of target and biases together stays together: from a first fix on, and where the target is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tracking.test_joint_biases import BETA, COUNT, MOTION, SETTINGS, STD, averaged, heard
from zenoh_cbef.tracking.filters import Belief, make_filter
from zenoh_cbef.tracking.filters.around.recovering import widened
from zenoh_cbef.tracking.filters.base import Shared
from zenoh_cbef.tracking.filters.finding.remembered_ranges import Remembered, Wandering
from zenoh_cbef.tracking.filters.finding.squared_ranges import Seen
from zenoh_cbef.tracking.filters.models.joint_biases import JointBiases
from zenoh_cbef.tracking.filters.rows import some, together
from zenoh_cbef.tracking.joint import _Joint
from zenoh_cbef.tracking.linalg import BY_LIBRARY
from zenoh_cbef.tracking.ranging import Space, unheard

GAMMA, SCALE = 0.7, 0.05
WHOLE = replace(SETTINGS, common_bias_std=GAMMA, whole_biases=True)
STILL = Wandering(0.0, 1.0)


def fixed(random):
    """Agents' ranges of eight steps, linearised at a fix, and what was known before them."""
    state = np.repeat(random.normal(size=(1, 6)), COUNT, axis=0)
    places = np.repeat(random.normal(scale=6.0, size=(COUNT, 1, 3)), 8, axis=1)
    ages = np.repeat(np.arange(8.0)[None, ::-1] * MOTION.dt, COUNT, axis=0)
    ranges = random.uniform(4.0, 9.0, (COUNT, 8))
    ranges[1, 2:5] = np.nan
    prior = Belief(state + 0.5, np.repeat(np.diag([9.0] * 3 + [4.0] * 3)[None], COUNT, axis=0))
    return Remembered.at(Space(), state, Seen(places, ages, ranges)), prior


def by_least_squares(ranges, prior, scale):
    """Mean and covariance of state, all biases, and perhaps a share of all ranges, from all ranges at once."""
    size = 6 + COUNT + (scale > 0.0)
    matrix, vector = np.zeros((size, size)), np.zeros(size)
    for agent in range(COUNT):
        there = ranges.measured[agent]
        rows = np.zeros((there.sum(), size))
        rows[:, :6], rows[:, 6 + agent] = ranges.rows[agent][there], 1.0
        if scale:
            rows[:, -1] = ranges.distance[agent][there]
        value = ranges.innovation[agent][there] + ranges.rows[agent][there] @ ranges.state[agent]
        matrix += rows.T @ rows / STD**2
        vector += rows.T @ value / STD**2
    known = np.linalg.inv(prior.known_covariance[0])
    matrix[:6, :6] += known
    vector[:6] += known @ prior.state[0]
    matrix[6 : 6 + COUNT, 6 : 6 + COUNT] += np.linalg.inv(GAMMA**2 + BETA**2 * np.eye(COUNT))
    if scale:
        matrix[-1, -1] += scale**-2
    covariance = np.linalg.inv(matrix)
    return covariance @ vector, covariance


def begun(ranges, prior):
    """Where agents begin after the fix."""
    ones = np.ones_like(ranges.ages)
    tied = ranges.shared(ones, STD**2 * ones, STILL, 3, prior, agents=COUNT, inversion=BY_LIBRARY)
    return Belief(ranges.state, prior.known_covariance, tied=tied)


def ahead(mean, covariance):
    """A step later."""
    step, noise = np.eye(len(mean)), np.zeros_like(covariance)
    step[:6, :6], noise[:6, :6] = MOTION.transition, MOTION.process_noise
    return step @ mean, step @ covariance @ step.T + noise


@pytest.mark.parametrize("scale", [0.0, SCALE])
def test_agents_begin_with_all_that_the_ranges_of_a_fix_say(scale):
    ranges, prior = fixed(np.random.default_rng(4))
    chosen = JointBiases.of(replace(WHOLE, scale_std=scale), np.inf)
    found = averaged(begun(ranges, prior), unheard(heard(np.random.default_rng(5))), chosen)
    mean, covariance = ahead(*by_least_squares(ranges, prior, scale))
    np.testing.assert_allclose(found.memory[0], np.repeat(mean[None], COUNT, axis=0), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.memory[1][0], covariance, rtol=1e-6, atol=1e-8)


def test_so_does_the_centralised_filter():
    """Which has the common part of all biases as a state of its own."""
    ranges, prior = fixed(np.random.default_rng(4))
    start = Belief(ranges.state[:1], prior.known_covariance[:1])
    filter_ = _Joint(replace(WHOLE, scale_std=SCALE), np.inf, start, COUNT)
    filter_.begin(start, begun(ranges, prior).tied)
    for belief, scale in ((filter_._biased, 0.0), (filter_._scaled, SCALE)):  # noqa: SLF001
        mean, covariance = by_least_squares(ranges, prior, scale)
        whole = np.zeros((len(mean), len(mean) + 1))
        whole[:6, :6], whole[6:, 7:], whole[6 : 6 + COUNT, 6] = np.eye(6), np.eye(len(mean) - 6), 1.0
        np.testing.assert_allclose(whole @ belief.state[0], mean, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(whole @ belief.known_covariance[0] @ whole.T, covariance, rtol=1e-6, atol=1e-8)


def test_biases_may_have_nothing_but_their_common_part():
    random = np.random.default_rng(7)
    ranges, prior = fixed(random)
    alone = JointBiases.of(replace(WHOLE, own_bias_std=0.0), np.inf)
    belief = averaged(begun(ranges, prior), heard(random), alone)
    found = belief.memory[0][:, 6:]
    np.testing.assert_allclose(found, np.full_like(found, found[0, 0]), rtol=1e-3)
    assert np.isfinite(belief.known_covariance).all()


@pytest.mark.parametrize("joint", [True, False])
def test_a_target_that_may_be_elsewhere_says_nothing_of_biases(joint):
    """Of a bias and a place whose sum is known; by earlier rules the bias was known after the next ranges."""
    random, found = np.random.default_rng(6), {}
    place = np.array([9.0, 0.0, 0.0]) + random.normal(scale=3.0, size=(COUNT, 3))
    step = replace(heard(random), position=place, range=np.linalg.norm(place, axis=1) + 0.3, age=np.zeros(COUNT))
    for whole in (True, False):
        settings = replace(SETTINGS, common_bias_std=GAMMA, own_bias_std=0.01, told_biases=False)
        chosen = make_filter("icf", replace(settings, joint_biases=joint, whole_biases=whole))
        belief = Belief(np.zeros((COUNT, 6)), np.repeat(np.diag([4.0] * 3 + [1e-6] * 3)[None], COUNT, axis=0))
        for _ in range(10):
            belief = averaged(belief, step, chosen)
        wide = widened(chosen, belief, np.full(COUNT, 1e4))
        after = averaged(wide, step, chosen)
        assert belief.bias
        assert after.bias
        found[whole] = after.bias.std / belief.bias.std
        np.testing.assert_allclose(wide.known_covariance, 1e4 * belief.known_covariance)
    assert found[True].min() > 0.95
    assert found[False].max() < 0.7


def test_a_tie_goes_with_its_rows():
    ranges, prior = fixed(np.random.default_rng(4))
    belief = begun(ranges, prior)
    rows = [np.array([2, 0]), np.array([1, 3])]
    back = together([some(belief, each) for each in rows], rows)
    assert isinstance(back.tied, Shared)
    np.testing.assert_array_equal(back.tied.matrix, belief.tied.matrix)
