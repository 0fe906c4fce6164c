"""All ranges of a step are taken in together: which are wrong is decided by all of them."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.tracking.filters.models.branching import Branches, Heard
from zenoh_cbef.tracking.filters.models.branching import conditioned as taken_in
from zenoh_cbef.tracking.filters.models.expecting import likelihoods

PLACES = np.array([[-9.0, -7, 3], [8, -6, -5], [7, 8, 2], [-6, 9, -7], [1, -9, 9], [-2, 5, -8]])
STD = 0.1


def prior_of(state, covariance, biases=None):
    """One prior of each agent."""
    return Branches.of((state[:, None], covariance[:, None], np.zeros((len(state), 1))), 3, biases)


def conditioned(prior, heard, outliers):
    """State, covariance and logarithm of the likelihood, after all ranges."""
    return taken_in(prior, heard, outliers).merged()


def heard_of(places, errors, bias=0.0):
    """Ranges of targets (n, 3) to all agents, with errors (n, m) in units of the noise."""
    true = np.linalg.norm(places[:, None] - PLACES, axis=2)
    shape = true.shape
    anchors = np.broadcast_to(PLACES, (*shape, 3))
    return Heard(anchors, np.zeros(shape), true + STD * errors + bias, np.zeros(shape), np.full(shape, STD**2))


def far(count, random):
    """Priors of targets a kilometre away, known along and across the line of sight to some metres, and the truths."""
    covariance = np.diag([5.0, 5.0, 5.0, 1.0, 1.0, 1.0]) ** 2
    truth = np.array([600.0, -700, 400, 1, 2, 3]) + random.normal(size=(count, 6))
    state = truth + random.multivariate_normal(np.zeros(6), covariance, count)
    return truth, prior_of(state, np.repeat(covariance[None], count, axis=0))


def test_estimates_from_a_wide_prior_are_as_good_as_they_claim():
    random = np.random.default_rng(3)
    truth, prior = far(500, random)
    state, covariance, _ = conditioned(prior, heard_of(truth[:, :3], random.normal(size=(500, 6))), None)
    error = state - truth
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    assert 0.85 < nees.mean() / 6 < 1.15


def test_a_range_that_the_prior_allows_is_found_wrong_by_the_others():
    random = np.random.default_rng(4)
    truth, prior = far(200, random)
    errors = random.normal(size=(200, 6))
    clean = errors.copy()
    errors[:, 2] += 40.0  # 4 m, of a range that is known to 5 m beforehand
    without = heard_of(truth[:, :3], clean)
    without.range[:, 2] = np.nan
    best = conditioned(prior, without, (0.3, 20.0))[0]
    found = conditioned(prior, heard_of(truth[:, :3], errors), (0.3, 20.0))[0]
    off = [np.sqrt(np.mean((state - truth)[:, :3] ** 2)) for state in (best, found)]
    assert off[1] < 1.1 * off[0]


def test_constant_errors_are_estimated_beside_the_target():
    random = np.random.default_rng(5)
    count, bias = 200, random.normal(size=(200, 6)) * 0.5
    spread = np.diag([0.3] * 3 + [1.0] * 3 + [0.5] * 6) ** 2
    truth = np.concatenate([random.normal(size=(count, 6)), bias], axis=1)
    state = truth + random.multivariate_normal(np.zeros(12), spread, count)
    state[:, 6:] = 0.0
    prior = prior_of(state, np.repeat(spread[None], count, axis=0), 6)
    found, covariance, _ = conditioned(prior, heard_of(truth[:, :3], random.normal(size=(count, 6)), bias), None)
    error = found - truth
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    assert 0.85 < nees.mean() / 12 < 1.15


def test_guesses_that_no_range_fits_are_given_up_at_once():
    random = np.random.default_rng(6)
    truth = np.array([[3.0, -2, 1, 0, 0, 0]])
    states = np.stack([truth + np.array([12.0, 0, 0, 0, 0, 0]), np.zeros((1, 6))], axis=1)
    spreads = np.stack([np.diag([1.0] * 6), np.diag([170.0] * 3 + [1.0] * 3) ** 2])[None]
    heard = heard_of(truth[:, :3], random.normal(size=(1, 6)))
    alone, both = (
        conditioned(Branches.of((states, spreads, np.log([[1.0 - doubt, doubt + 1e-300]])), 3), heard, None)[0]
        for doubt in (0.0, 0.01)
    )
    assert np.linalg.norm((both - truth)[0, :3]) < 2.0 < np.linalg.norm((alone - truth)[0, :3])


@pytest.mark.parametrize("spread", [0.01, 0.3, 3.0])
@pytest.mark.parametrize("outliers", [(0.3, 20.0), None])
def test_how_likely_a_wrong_range_is_does_not_depend_on_how_its_square_is_linearised(spread, outliers):
    # Errors of 5 and 30 m: their densities are what the distribution says, whatever a motion leaves open of the place.
    place, prior = np.array([[1.0, 2, -1, 0, 0, 0]]), np.diag([spread] * 3 + [1.0] * 3)[None] ** 2
    known = (place[:, None], prior[:, None], np.zeros((1, 1)))
    densities = {}
    for exact in (True, False):
        branches = Branches.of(known, 3, share=np.full((1, 1), 0.02), exact=exact)
        told = []
        for error in (5.0, 30.0):
            heard = heard_of(place[:, :3], np.full((1, 6), error / STD))
            told.append(likelihoods(branches.expected(heard, 0), heard.variance[:, :1], outliers, branches.share)[1])
        densities[exact] = float(told[1][0, 0] - told[0][0, 0])
    # The place is farther off on average than its mean is, by what is left open across the line of sight.
    length = np.linalg.norm(place[0, :3] - PLACES[0])
    half, bend = np.sqrt(0.5 * np.pi * (branches.expected(heard, 0).variance + STD**2))[0, 0], 1.5 * spread**2 / length
    if outliers is not None:
        assert densities[True] == pytest.approx(-25.0 / (20.0 + half), abs=0.01)
        assert abs(densities[False] - densities[True]) > 0.2
        return
    scale = 50.0 * STD + half
    longer = (1.0 + (5.0 - bend) / scale) / (1.0 + (30.0 - bend) / scale)
    assert densities[True] == pytest.approx(2.0 * np.log(longer), abs=0.01)


def test_a_wrong_range_is_as_sure_as_the_distance_and_the_bias_together():
    random = np.random.default_rng(8)
    root = random.normal(size=(12, 12)) * np.repeat([0.3, 1.0, 0.5], [3, 3, 6])[:, None]
    state, covariance = random.normal(size=12), root @ root.T
    known = state[None, None], covariance[None, None], np.zeros((1, 1))
    told = Branches.of(known, 3, 6, exact=True).expected(heard_of(state[None, :3], np.zeros((1, 6))), 2)
    row = np.zeros(12)
    row[8] = 1.0
    length = told.distance[0, 0] - state[8]
    row[:3] = (state[:3] - PLACES[2]) / length
    # e has about its regression on the place what a Gaussian leaves open of a square.
    slack = np.sum(covariance[:3, :3] ** 2) / (2.0 * length**2)
    assert told.around[0, 0] == pytest.approx(row @ covariance @ row + slack + STD**2)


def test_a_row_is_the_same_in_every_batch():
    random = np.random.default_rng(7)
    truth, prior = far(7, random)
    heard = heard_of(truth[:, :3], 30.0 * random.normal(size=(7, 6)))
    heard.range[2, 3] = np.nan
    together = conditioned(prior, heard, (0.3, 20.0))
    for row in range(7):
        own = slice(row, row + 1)
        one = Branches(prior.mean[own], prior.covariance[own], prior.likelihood[own], prior.wrong[own], 3)
        alone = conditioned(one, Heard(*(part[own] for part in vars(heard).values())), (0.3, 20.0))
        for whole, part in zip(together, alone, strict=True):
            np.testing.assert_array_equal(whole[own], part)
