"""Hypotheses that the target is elsewhere rise while ranges deny where it is, and take over."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tracking.test_branching import STD, heard_of
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import Heard as Ranges
from zenoh_cbef.simulator import heard_in, simulate
from zenoh_cbef.tracking.filters.models.branching import KEPT, Branches
from zenoh_cbef.tracking.filters.models.contending import Contest, share, uncounted
from zenoh_cbef.tracking.filters.models.expecting import likelihoods
from zenoh_cbef.tracking.filters.models.mixtures import NEVER
from zenoh_cbef.tracking.status import LOST, TRACKING

MANY = ("sensor.outlier_probability=0.6", "sensor.outlier_scale=20", "steps=120")
FAR = "filter.initial_position=[7,7,7]"


def anywhere(count):
    """One prior of each agent that says next to nothing."""
    covariance = np.diag([170.0] * 3 + [1.0] * 3) ** 2
    return np.zeros((count, 1, 6)), np.tile(covariance, (count, 1, 1, 1)), np.zeros((count, 1))


def sure(states):
    """Of each agent one prior that is right and none that rises: (count, 6)."""
    shape = len(states), 2 * KEPT
    likelihood = np.full(shape, NEVER)
    likelihood[:, 0] = 0.0
    return np.repeat(states[:, None], shape[1], axis=1), np.tile(0.1**2 * np.eye(6), (*shape, 1, 1)), likelihood


def contested(guess, truth, steps, errors):
    """What is known after so many steps of a target at rest, and the mean place after each."""
    contest, counts, agree = Contest(3, None), uncounted(len(guess)), np.zeros(len(guess), dtype=bool)
    priors, found = sure(guess), []
    for step in range(steps):
        holds, rises = (Branches.of(half, 3, None, share(counts)) for half in contest.halves(priors))
        new = heard_of(truth, errors[step])
        whole, (*later, counts) = contest.after(holds, rises, anywhere(len(guess)), new, counts, off=agree)
        state, covariance, likelihood = later
        priors = state, covariance + 1e-4 * np.eye(6), likelihood
        found.append(whole.merged()[0][:, :3])
    return contest, counts, np.stack(found)


def test_a_place_that_ranges_deny_is_left_though_many_are_wrong():
    random = np.random.default_rng(1)
    truth, guess = np.tile([1.0, -2, 3], (20, 1)), np.tile([8.0, 5, 9, 0, 0, 0], (20, 1))
    errors = random.normal(size=(25, 20, 6)) + 300.0 * (random.random((25, 20, 6)) < 0.3)
    _, _, found = contested(guess, truth, 25, errors)
    assert (np.linalg.norm(found[-1] - truth, axis=1) < 1.0).sum() >= 19


def test_a_place_that_most_ranges_fit_is_kept_through_steps_of_wrong_ones():
    random = np.random.default_rng(2)
    truth = np.tile([1.0, -2, 3], (20, 1))
    guess = np.concatenate([truth, np.zeros((20, 3))], axis=1)
    errors = random.normal(size=(40, 20, 6))
    errors[10::10, :, :5] += 100.0
    contest, counts, found = contested(guess, truth, 40, errors)
    assert np.linalg.norm(found - truth, axis=2).max() < 1.0
    assert not contest.denied(counts).any()
    assert (share(counts) < 0.12).all()


def test_a_row_comes_out_the_same_beside_rows_in_doubt():
    random = np.random.default_rng(3)
    truth = np.tile([1.0, -2, 3], (2, 1))
    guess = np.concatenate([truth, np.zeros((2, 3))], axis=1)
    guess[1, :3] += 9.0
    errors = random.normal(size=(12, 2, 6))
    both = contested(guess, truth, 12, errors)
    for row in range(2):
        own = slice(row, row + 1)
        alone = contested(guess[own], truth[own], 12, errors[:, own])
        np.testing.assert_array_equal(both[2][:, own], alone[2])
        np.testing.assert_array_equal(both[1][own], alone[1])


def test_a_place_of_which_nothing_is_known_makes_no_range_likelier_wrong():
    prior = Branches.of(anywhere(1), 3, None, np.full((1, 1), 0.02))
    expected = prior.expected(heard_of(np.array([[1.0, -2, 3]]), np.zeros((1, 6))), 0)
    for outliers in (None, (0.3, 20.0)):
        right, wrong = likelihoods(expected, np.full((1, 1), STD**2), outliers, prior.share)
        assert right > wrong
    assert np.diff(likelihoods(expected, np.full((1, 1), STD**2), (0.3, 20.0)), axis=0) > 0.0  # by the first rules


def trace_of(*sets, wrong=0.0):
    """A run in which a share of the ranges is 30 m too long without the scenario saying so."""
    scenario = load("tracking", [*sets, "seed=1002"]).scenario
    heard = heard_in(Plan(scenario), make_world(scenario))
    more = 30.0 * (np.random.default_rng(7).random(heard.ranges.shape) < wrong)
    return simulate([scenario], heard=[Ranges(heard.positions, heard.ranges + more, heard.age)])[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sets", "wrong"), [(MANY, 0.0), ((*MANY, FAR), 0.0), (("filter.initial_position_std=5", "steps=120"), 0.4)]
)
def test_a_network_among_many_wrong_ranges_is_not_lost(sets, wrong):
    trace = trace_of(*sets, wrong=wrong)
    off = np.linalg.norm((trace.estimates - trace.truth)[:, 40:, :3], axis=2)
    assert off.max() < 1.0
    assert (trace.diagnostics.status[:, 40:] == TRACKING).mean() > 0.9


@pytest.mark.slow
def test_by_earlier_rules_it_was():
    trace = trace_of(*MANY, "filter.defaults=12")
    assert (trace.diagnostics.status[:, 40:] == LOST).mean() > 0.5
