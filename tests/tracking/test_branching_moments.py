"""What ranges tell of a target, against exact moments, samples, and every way in which some of them may be wrong."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from zenoh_cbef.tracking.filters.models.branching import KEPT, MOST, Branches, Heard, conditioned
from zenoh_cbef.tracking.filters.models.expecting import likelihoods
from zenoh_cbef.tracking.filters.models.mixtures import NEVER

STD = 0.1
SPREADS = np.array([0.3, 0.2, 0.25, 0.4, 0.5, 0.3])
OUTLIERS = 0.2, 8.0
PLACES = np.array([[-9.0, -7, 3], [8, -6, -5], [7, 8, 2], [-6, 9, -7]])


def covariance_of(size, random):
    """One whose components depend on each other."""
    root = random.normal(size=(size, size))
    scale = np.resize(SPREADS, size)
    correlation = root @ root.T + size * np.eye(size)
    scale = scale / np.sqrt(np.diag(correlation))
    return correlation * np.outer(scale, scale)


def samples(mean, covariance, count, random):
    return mean + random.multivariate_normal(np.zeros(len(mean)), covariance, count)


def branches_of(state, covariance, axes, biases=None, *, adds=False):
    """One branch each of n agents: states (n, s), covariances (n, s, s) or the same one of all."""
    wide = np.broadcast_to(covariance, (len(state), *np.shape(covariance)[-2:]))
    return Branches.of((state[:, None], wide[:, None], np.zeros((len(state), 1))), axes, biases, adds=adds)


def heard(places, ranges, age=0.0, height=0.0):
    """Ranges (n, m) of agents at places (m, axes), alike for n agents."""
    shape = np.shape(ranges)
    anchors = np.broadcast_to(places, (*shape, np.shape(places)[-1]))
    return Heard(anchors, np.full(shape, height), np.array(ranges), np.full(shape, age), np.full(shape, STD**2))


@pytest.mark.parametrize("axes", [2, 3])
def test_the_square_of_a_position_has_its_exact_moments(axes):
    """A product of Gauss and Hermite's rule of three points is exact up to the fifth power."""
    random = np.random.default_rng(1)
    size = 2 * axes
    mean, covariance = random.normal(size=size), covariance_of(size, random)
    nodes, weights = np.polynomial.hermite_e.hermegauss(3)
    nodes = np.array(list(product(nodes, repeat=size)))
    weight = np.prod(list(product(weights / weights.sum(), repeat=size)), axis=1)
    states = mean + nodes @ np.linalg.cholesky(covariance).T
    states = np.column_stack([states, (states[:, :axes] ** 2).sum(axis=1)])
    middle = weight @ states
    found = branches_of(mean[None], covariance, axes)
    np.testing.assert_allclose(found.mean[0, 0], middle)
    np.testing.assert_allclose(found.covariance[0, 0], (weight[:, None] * (states - middle)).T @ (states - middle))


@pytest.mark.parametrize(("axes", "height", "more"), [(3, 0.0, 0), (2, 4.0, 0), (3, 0.0, 1)])
def test_a_range_is_expected_from_where_the_target_was(axes, height, more):
    """Of a target that is known, with no bias: mean and variance of (d + v)^2, and how d^2 changes with the state."""
    random, age = np.random.default_rng(2), 0.3
    state, place = np.pad(random.normal(size=2 * axes), (0, more)), random.normal(scale=5.0, size=axes)

    def square(at):
        distance = ((at[:axes] - age * at[axes : 2 * axes] - place) ** 2).sum() + height
        return (np.sqrt(distance) + at[2 * axes :].sum()) ** 2

    known = np.zeros((len(state), len(state)))
    branches = branches_of(state[None], known, axes, 2 * axes if more else None)
    told = branches.expected(heard(place, [[7.0]], age, height), 0)
    distance = np.sqrt(square(state))
    np.testing.assert_allclose(told.distance[0, 0], distance)
    np.testing.assert_allclose(told.unit[0, 0], 2.0 * distance)
    np.testing.assert_allclose(told.excess[0, 0], 49.0 - square(state) - STD**2)
    np.testing.assert_allclose(told.total[0, 0], 4.0 * distance**2 * STD**2 + 2.0 * STD**4)
    assert told.variance[0, 0] == 0.0
    slope = [(square(state + step) - square(state - step)) / 2e-5 for step in 1e-5 * np.eye(len(state))]
    row = told.row[0, 0, :-1].copy()
    row[:axes] += 2.0 * told.row[0, 0, -1] * state[:axes]  # the last component is |p|^2
    np.testing.assert_allclose(row, slope, rtol=1e-6)


def test_a_bias_adds_its_mean_and_its_spread():
    """Of a target that is known: the mean of (d + b + v)^2, of the bias of the agent that measured."""
    state, place = np.array([[1.0, -2, 0.5, 0, 0, 0, 0.6, -0.4]]), PLACES[0]
    covariance = np.diag([0.0] * 6 + [0.3, 0.2]) ** 2
    distance = np.linalg.norm(state[0, :3] - place)
    branches = branches_of(state, covariance, 3, 6)
    for agent, which in ((0, None), (1, None), (0, np.array([1]))):
        told = branches.expected(heard(np.stack([place, place]), [[7.0, 7.0]]), agent, which)
        bias, std = ((0.6, 0.3), (-0.4, 0.2))[agent if which is None else which[0]]
        np.testing.assert_allclose(told.distance[0, 0], distance + bias)
        np.testing.assert_allclose(told.excess[0, 0], 49.0 - (distance + bias) ** 2 - std**2 - STD**2)


def test_a_range_that_is_as_expected_is_linearised_where_the_target_is_expected():
    """However wide the prior is, and whatever the bias."""
    state, covariance = np.array([[3.0, 0, 0, 0, 0, 0, 0.6]]), np.diag([0.2, 0, 0, 0, 0, 0, 0.3]) ** 2
    distance = np.sqrt(9.0 + 0.2**2)
    told = branches_of(state, covariance, 3, 6).expected(heard(np.zeros((1, 3)), [[distance + 0.6]]), 0)
    np.testing.assert_allclose(told.unit[0, 0], 2.0 * distance)


@pytest.mark.parametrize("std", [0.03, 0.1, 0.3])
def test_noise_adds_no_information_on_average(std):
    """The prior is wide along the line of sight, so the distance where a range is linearised follows its noise."""
    state, covariance = np.array([[3.0, 0, 0, 0, 0, 0]]), np.diag([std, 0, 0, 0, 0, 0]) ** 2
    ranges = 3.0 + STD * np.array([[1.0], [-1.0]])
    told = branches_of(state.repeat(2, axis=0), covariance, 3).expected(heard(np.zeros((1, 3)), ranges), 0)
    # What is expected is E d^2 = 9 + std^2, and what is measured here is 9.
    off = (told.excess + std**2) / told.unit**2
    assert abs(off.mean()) < 0.05 * STD**2 / 36.0


def test_no_range_is_linearised_nearer_than_a_tenth_of_its_noise():
    told = branches_of(np.zeros((1, 6)), np.zeros((6, 6)), 3).expected(heard(np.zeros((1, 3)), [[0.0]]), 0)
    np.testing.assert_allclose([told.distance[0, 0], told.unit[0, 0]], [0.1 * STD, 0.2 * STD])


@pytest.mark.parametrize("biases", [None, 6])
@pytest.mark.parametrize("scale", [0.2, 1.0])
def test_what_is_expected_of_ranges_is_right_on_average_and_as_sure_as_it_says(biases, scale):
    random, count, age = np.random.default_rng(3), 40_000, 0.2
    size = 6 if biases is None else 8
    covariance, mean = scale**2 * covariance_of(size, random), np.array([1.0, -2, 0.5, 2, 1, -1, 0, 0][:size])
    truth = samples(mean, covariance, count, random)
    bias = 0.0 if biases is None else truth[:, 7]
    # Errors of the same size on both sides: what is left on average is no chance.
    noise = STD * np.resize([1.0, -1.0], count)
    ranges = np.linalg.norm(truth[:, :3] - age * truth[:, 3:6] - PLACES[1], axis=1) + bias + noise
    branches = branches_of(np.broadcast_to(mean, truth.shape), covariance, 3, biases)
    told = branches.expected(heard(PLACES[:2], np.stack([ranges, ranges], axis=1), age), 1)
    off = (told.excess / np.sqrt(told.total))[:, 0]
    assert abs(off.mean()) < 0.025
    assert 0.96 < off.var() < 1.04
    if biases is None:
        assert np.var(ranges - noise) == pytest.approx(told.variance[0, 0], rel=0.05)
        assert np.mean(ranges) == pytest.approx(told.distance[0, 0], abs=0.02)


@pytest.mark.parametrize(("outliers", "share", "long"), [(OUTLIERS, *OUTLIERS), (None, 0.02, 50.0 * STD)])
def test_a_range_is_right_or_wrong_with_probabilities_that_are_one_together(outliers, share, long):
    """Innovations that are wrong are exponential beyond zero, or on both sides where nothing is told of them."""
    grid = np.linspace(-200.0, 200.0, 400_001)
    step = grid[1] - grid[0]
    state = np.array([[3.0, 4, 0, 0, 0, 0]])
    told = branches_of(state, np.diag(SPREADS**2), 3).expected(heard(np.zeros((1, 3)), [[5.0]]), 0)
    for name in ("excess", "total", "unit", "beyond", "around"):
        object.__setattr__(told, name, getattr(told, name).repeat(len(grid), axis=1))
    object.__setattr__(told, "excess", grid[None] * told.unit)
    object.__setattr__(told, "beyond", grid[None])
    right, wrong = (np.exp(one[0]) for one in likelihoods(told, np.array([[STD**2]]), outliers))
    assert right.sum() * step == pytest.approx(1.0 - share)
    variance = (right * grid**2).sum() / right.sum()
    assert variance == pytest.approx(told.total[0, 0] / told.unit[0, 0] ** 2)
    beyond = grid >= 0.0
    assert wrong[beyond].sum() * step == pytest.approx(share if outliers else 0.5 * share, rel=1e-3)
    assert (wrong * grid)[beyond].sum() / wrong[beyond].sum() == pytest.approx(long, rel=1e-3)
    if outliers is None:
        np.testing.assert_allclose(wrong, wrong[::-1])
    else:
        # Too short ranges are none of these, but for the noise.
        short = wrong[~beyond] / wrong[beyond][0]
        np.testing.assert_allclose(short, np.exp(-0.5 * grid[~beyond] ** 2 / variance), rtol=1e-6, atol=1e-300)


def every_way(mean, covariance, places, ranges):
    """Weights, means and covariances of Kalman filters of distances, for each way in which ranges may be wrong."""
    (share, long), axes = OUTLIERS, places.shape[1]
    for ways in product([True, False], repeat=len(ranges)):
        state, spread, weight = mean, covariance, 1.0
        for right, place, length in zip(ways, places, ranges, strict=True):
            offset = state[:axes] - place
            distance = np.linalg.norm(offset)
            row = np.concatenate([offset / distance, np.zeros(axes)])
            off, variance = length - distance, row @ spread @ row + STD**2
            if right:
                weight *= (1.0 - share) * np.exp(-0.5 * off**2 / variance) / np.sqrt(2.0 * np.pi * variance)
                gain = spread @ row / variance
                state, spread = state + gain * off, spread - np.outer(gain, row @ spread)
            else:
                weight *= share / long * np.exp(-off / long if off > 0.0 else -0.5 * off**2 / variance)
        yield weight, state, spread


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("wrong", [(), (2,), (0, 3)])
def test_branches_are_all_ways_in_which_ranges_of_a_far_target_may_be_wrong(wrong, axes):
    """So far away that a sphere is a plane, as a Kalman filter takes it to be."""
    random = np.random.default_rng(4)
    covariance, mean = covariance_of(2 * axes, random), np.zeros(2 * axes)
    places = 1e4 * PLACES[:, :axes]
    truth = samples(mean, covariance, 1, random)[0, :axes]
    ranges = np.linalg.norm(truth - places, axis=1) + STD * random.normal(size=4)
    ranges[list(wrong)] += 1.2
    found = list(every_way(mean, covariance, places, ranges))
    weights = np.array([weight for weight, *_ in found])
    share = weights / weights.sum()
    state = sum(part * one for part, (_, one, _) in zip(share, found, strict=True))
    spread = sum(
        part * (one + np.outer(at - state, at - state)) for part, (_, at, one) in zip(share, found, strict=True)
    )
    after = conditioned(branches_of(mean[None], covariance, axes), heard(places, ranges[None]), OUTLIERS)
    merged = after.merged()
    np.testing.assert_allclose(merged[0][0], state, atol=1e-4)
    np.testing.assert_allclose(merged[1][0], spread, atol=1e-5)
    np.testing.assert_allclose(merged[2][0], np.log(weights.sum()), atol=1e-4)
    np.testing.assert_array_equal(merged[1], merged[1].swapaxes(1, 2))


def mixture_of(states, covariances, likelihood):
    """Mean and covariance of one agent's priors, and the logarithm of their likelihood."""
    weight = np.exp(likelihood)
    share = weight / weight.sum()
    mean = share @ states
    apart = states - mean
    return mean, np.einsum("k,kij->ij", share, covariances) + (share[:, None] * apart).T @ apart, np.log(weight.sum())


def several(random, agents=3, count=12):
    """Branches of which some are near one another and others are not."""
    states = np.zeros((agents, count, 6))
    states[:, :, :3] = np.repeat(random.normal(scale=4.0, size=(agents, 6, 3)), count // 6, axis=1)
    states += 0.05 * random.normal(size=states.shape)
    covariances = np.stack([covariance_of(6, random) for _ in range(agents * count)]).reshape(agents, count, 6, 6)
    return Branches.of((states, covariances, random.normal(scale=2.0, size=(agents, count)) - 30.0), 3)


def test_what_stays_for_later_steps_has_the_moments_of_all_branches():
    branches = several(np.random.default_rng(5))
    kept, merged = branches.distinct(), branches.merged()
    for agent in range(3):
        states, spreads = branches.mean[agent, :, :6], branches.covariance[agent, :, :6, :6]
        all_of = mixture_of(states, spreads, branches.likelihood[agent])
        mean, spread, likelihood = mixture_of(kept[0][agent], kept[1][agent], kept[2][agent])
        assert kept[2][agent].max() == 0.0
        assert kept[2].shape[1] == KEPT
        assert likelihood < np.log(KEPT)
        for found in ((mean, spread), (merged[0][agent], merged[1][agent])):
            np.testing.assert_allclose(found[0], all_of[0], atol=1e-12)
            np.testing.assert_allclose(found[1], all_of[1], atol=1e-12)
        np.testing.assert_allclose(merged[2][agent], all_of[2])


def test_branches_near_a_likelier_one_are_merged_with_it_and_others_stay_apart():
    """Near are those within a deviation, of all components together, as the likelier one knows them."""
    near, far = np.sqrt(6.0) - 0.01, np.sqrt(6.0) + 0.01
    states, covariances = np.zeros((1, 6, 6)), np.eye(6)[None, None].repeat(6, axis=1)
    covariances[0, 0, 4, 4], covariances[0, 1] = 4.0, 9.0 * np.eye(6)
    states[0, 1, 0] = near
    states[0, 2, 4], states[0, 3, 4], states[0, 4, 5], states[0, 5, 3] = 2.0 * far, -2.0 * far, 9.0, 99.0
    likelihood = np.log([[0.32, 0.16, 0.08, 0.04, 0.02, 0.02]])
    kept = Branches.of((states, covariances, likelihood), 3).distinct()
    # The last one that stays is all that is left.
    np.testing.assert_allclose(np.exp(kept[2]), [[1.0, 0.08 / 0.48, 0.04 / 0.48, 0.04 / 0.48]])
    expected = np.zeros((1, 4, 6))
    expected[0, 0, 0], expected[0, 1, 4], expected[0, 2, 4] = near / 3.0, 2.0 * far, -2.0 * far
    expected[0, 3, [3, 5]] = 49.5, 4.5
    np.testing.assert_allclose(kept[0], expected, atol=1e-12)


def test_what_is_not_there_is_never_right():
    one = Branches.of((np.zeros((1, 2, 6)), np.eye(6)[None, None].repeat(2, axis=1), np.array([[-3.0, NEVER]])), 3)
    kept = one.distinct()
    assert kept[2][0, 0] == 0.0
    assert (kept[2][0, 1:] < 0.9 * NEVER).all()


@pytest.mark.parametrize("distance", [11.0, 14.0, np.nan])
def test_the_likeliest_of_many_stay_as_if_each_had_branched_alone(distance):
    many, told = several(np.random.default_rng(6), count=24), heard(PLACES[:1], np.full((3, 1), distance))
    stay = many.after(told, 0, OUTLIERS, MOST)
    assert stay.likelihood.shape[1] == MOST
    each = []
    for place in range(24):
        one = slice(place, place + 1)
        priors = many.mean[:, one, :6], many.covariance[:, one, :6, :6], many.likelihood[:, one]
        each.append(Branches.of(priors, 3).after(told, 0, OUTLIERS, 2))
    likelihood = np.concatenate([one.likelihood for one in each], axis=1)
    mean, wrong = (np.concatenate([getattr(one, name) for one in each], axis=1) for name in ("mean", "wrong"))
    covariance = np.concatenate([one.covariance for one in each], axis=1)
    for agent in range(3):
        best = np.argsort(-likelihood[agent], kind="stable")[:MOST]
        np.testing.assert_array_equal(stay.likelihood[agent], likelihood[agent, best])
        np.testing.assert_array_equal(stay.mean[agent], mean[agent, best])
        np.testing.assert_array_equal(stay.covariance[agent], covariance[agent, best])
        np.testing.assert_array_equal(stay.wrong[agent], wrong[agent, best])
    assert stay.wrong.max() == np.isfinite(distance)


def test_a_range_that_is_missing_says_nothing():
    random = np.random.default_rng(7)
    prior = branches_of(random.normal(size=(2, 6)), covariance_of(6, random), 3)
    before, after = prior.merged(), conditioned(prior, heard(PLACES, np.full((2, 4), np.nan)), OUTLIERS).merged()
    for one, other in zip(before, after, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


def test_a_target_at_a_receiver_gives_numbers():
    state = np.zeros((1, 6))
    state[0, :3] = PLACES[0]
    after = conditioned(branches_of(state, 1e-6 * np.eye(6), 3), heard(PLACES, [[0.0, 12.0, 12.0, 12.0]]), OUTLIERS)
    assert all(np.isfinite(part).all() for part in after.merged())
