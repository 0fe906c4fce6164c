"""A turn in the last part of a step shows in no range, so what agents claim of the velocity allows for it."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.build import backwards_of
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.backwards import SeveralMotions
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.motion import Jump, NearlyConstantVelocity
from zenoh_cbef.tracking.switching import Switching

DT, LEAVING, TOLD = 0.1, 0.02, 0.05
SWITCHING = Switching((NearlyConstantVelocity(DT, 0.1), Jump(DT, 100.0)), (LEAVING,), unseen=True)
CORNER = (
    "target.motion=waypoints",
    "target.speed=3",
    "target.waypoints=[[-4,-4,0],[5,-4,0],[5,4,0]]",
    "steps=31",
)
"""A target that turns after 9 m, at the very end of a step."""


def claimed(speed, chance=(0.9999, 0.0001)):
    """Covariances of position and velocity, with and without what ranges do not show, of a target that goes on."""
    state = np.array([[1.0, 2.0, 3.0, 0.0, speed, 0.0]])
    parts = [(state, np.diag([TOLD**2] * 3 + [variance] * 3)[None]) for variance in (0.01, 25.0)]
    told = np.array([chance])
    return SWITCHING.claimed(told, parts)[1][0], SWITCHING.combined(told, parts)[1][0]


@pytest.mark.parametrize("speed", [3.0, 30.0])
def test_the_claim_is_at_least_that_of_turns_at_any_moment_and_less_than_twice_as_much(speed):
    allowed, before = claimed(speed)
    more = allowed - before
    assert not more[:3].any()
    assert not (more - np.diag(np.diag(more))).any()
    # A turn by N(0, s^2) at t before the end of the step, whose place differs by s t and is told to TOLD.
    square, late = 2.0 * speed**2 / 3.0, np.linspace(0.0, DT, 10_001)
    narrower = 1.0 + square * late**2 / TOLD**2
    exact = LEAVING * square * np.mean(narrower**-2.5)
    assert exact < more[4, 4] + before[4, 4] < 2.0 * exact + before[4, 4]


def test_a_target_at_rest_or_one_that_was_seen_to_turn_is_claimed_as_before():
    np.testing.assert_array_equal(*claimed(0.0))
    np.testing.assert_array_equal(*claimed(3.0, chance=(0.1, 0.9)))


def test_agents_are_less_sure_of_the_velocity_of_a_target_that_may_just_have_turned():
    before, after = (nees_at_the_corner(f"filter.defaults={rules}") for rules in (15, 16))
    assert before > 1000.0
    assert after < 0.6 * before


def nees_at_the_corner(*keys):
    """NEES of the first agent in the step in which the target turns."""
    (trace,) = simulate([load("tracking", [*CORNER, *keys]).scenario])
    turns = int(np.argmax(np.abs(np.diff(trace.truth[:, 4])))) + 1
    error = trace.estimates[0, turns] - trace.truth[turns]
    return error @ np.linalg.solve(trace.covariances[0, turns], error)


def test_a_smoother_goes_back_without_it_as_later_ranges_show_the_turn():
    state = np.array([[1.0, 2.0, 3.0, 0.0, 3.0, 0.0]])
    parts = tuple(Belief(state, np.diag([TOLD**2] * 3 + [one] * 3)[None]) for one in (0.01, 25.0))
    chance = np.array([[0.9999, 0.0001]])
    pairs = [(one.state, one.known_covariance) for one in parts]
    belief = Belief(*SWITCHING.claimed(chance, pairs), chance=chance, parts=parts)
    kept = SeveralMotions(SWITCHING).kept(belief)
    np.testing.assert_array_equal(kept.known_covariance, SWITCHING.combined(chance, pairs)[1])
    other = SeveralMotions(replace(SWITCHING, unseen=False)).kept(belief)
    np.testing.assert_array_equal(other.known_covariance, belief.known_covariance)
    plan = load("tracking", CORNER).plan
    assert backwards_of(plan) == SeveralMotions(plan.settings.switching)
