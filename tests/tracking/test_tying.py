"""A step's ranges from a wide prior are worth what least squares on them has, and say so."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.models.branching import Branches, Heard, conditioned
from zenoh_cbef.tracking.filters.models.mixtures import NEVER
from zenoh_cbef.tracking.filters.models.tying import tied

SIGMA, RUNS = 0.1, 400


def case(wide, *, ties=True, far=0.0, seed=3):
    """Branches before the ranges of six agents around the target, m; what was heard, and where the target is."""
    chance = np.random.default_rng(seed)
    agents = chance.uniform(-10.0, 10.0, (6, 3))
    truth = chance.uniform(-5.0, 5.0, (RUNS, 3)) + np.array([far, 0.0, 0.0])
    ranges = np.linalg.norm(truth[:, None] - agents, axis=2) + SIGMA * chance.standard_normal((RUNS, 6))
    none = np.zeros((RUNS, 6))
    heard = Heard(np.tile(agents, (RUNS, 1, 1)), none, ranges, none, none + SIGMA**2)
    mean = np.concatenate([truth + wide * chance.standard_normal((RUNS, 3)), np.zeros((RUNS, 3))], axis=1)
    spread = np.diag([wide**2] * 3 + [1.0] * 3)
    priors = mean[:, None], np.tile(spread, (RUNS, 1, 1, 1)), np.zeros((RUNS, 1))
    return Branches.of(priors, 3, ties=ties), heard, truth, agents


def error_and_nees(branches, truth):
    state, covariance, _ = branches.merged()
    off = state[:, :3] - truth
    nees = np.einsum("ri,rij,rj->r", off, np.linalg.inv(covariance[:, :3, :3]), off)
    return float(np.sqrt(np.median(np.sum(off**2, axis=1)))), float(np.median(nees)) / 2.366


def test_a_wide_prior_costs_no_accuracy():
    prior, heard, truth, agents = case(8.0)
    free, bound = conditioned(prior, heard, None), tied(conditioned(prior, heard, None), heard)
    (loose, _), (found, nees) = error_and_nees(free, truth), error_and_nees(bound, truth)
    rows = (truth[:, None] - agents) / np.linalg.norm(truth[:, None] - agents, axis=2)[:, :, None]
    best = SIGMA * np.sqrt(np.trace(np.linalg.inv(rows.swapaxes(1, 2) @ rows), axis1=1, axis2=2))
    assert found < 0.9 * loose
    assert found == pytest.approx(0.89 * np.median(best), rel=0.1)  # the median of errors, not their root mean square
    assert 0.8 < nees < 1.2


def test_a_narrow_prior_knows_the_square_already():
    prior, heard, _, _ = case(0.01)
    free = conditioned(prior, heard, None)
    bound = tied(free, heard)
    np.testing.assert_allclose(bound.mean[:, :, :3], free.mean[:, :, :3], atol=1e-3)  # a fiftieth of its deviation
    np.testing.assert_allclose(bound.likelihood[:, 0], free.likelihood[:, 0], atol=0.05)


def test_where_the_posterior_is_no_gaussian_branches_stay_as_they_are():
    prior, heard, _, _ = case(30.0, far=400.0)
    free = conditioned(prior, heard, None)
    likely = free.likelihood > 0.5 * NEVER
    np.testing.assert_array_equal(tied(free, heard).mean[likely], free.mean[likely])


def test_likelihoods_are_those_of_a_tie_from_the_start():
    prior, heard, _, _ = case(8.0)
    sure = replace(prior, wrong=prior.wrong)
    for agent in range(6):
        sure = sure.after(heard, agent, (1e-12, 5.0), 1)
    bound = tied(sure, heard)
    # The integral over all places of what the ranges tell, around the place that they tell of.
    place, spread = bound.merged()[0][0, :3], bound.merged()[1][0, :3, :3]
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(3), spread, 20_000)
    near, known = place + draws, np.linalg.inv(spread)
    drawn = -0.5 * np.einsum("ri,ij,rj->r", draws, known, draws) - 0.5 * np.linalg.slogdet(2.0 * np.pi * spread)[1]
    away = near - prior.mean[0, 0, :3]
    before = -0.5 * np.sum(away**2, axis=1) / 64.0 - 1.5 * np.log(2.0 * np.pi * 64.0)
    left = heard.range[0] - np.linalg.norm(near[:, None] - heard.place[0], axis=2)
    told = -0.5 * np.sum(left**2, axis=1) / SIGMA**2 - 3.0 * np.log(2.0 * np.pi * SIGMA**2)
    expected = np.log(np.mean(np.exp(told + before - drawn)))
    assert bound.likelihood[0, 0] == pytest.approx(expected, abs=0.5)
    assert abs(sure.likelihood[0, 0] - expected) > 1.0


def test_without_slack_nothing_is_tied():
    prior, heard, _, _ = case(8.0, ties=False)
    free = conditioned(prior, heard, None)
    assert tied(free, heard) is free
