"""A fix of ranges of which a few are wrong comes to rest near the agents."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.filters.damping import Damping, corrected

DAMPING = Damping((1.0, 2.0), 4.0)


def moved(by, passes, at=(1.0, 2.0)):
    """How far a correction goes that ranges ask for, and what is excused by it."""
    before = np.array([[*at, 0.5, -0.5]])
    after, excuses = DAMPING(before, before + np.array([[by, 0.0, 2.0 * by, 0.0]]), passes)
    return (after - before)[0], excuses[0]


def test_a_correction_gets_smaller_from_pass_to_pass_and_takes_its_velocity_along():
    first, excused = moved(100.0, 1)
    np.testing.assert_allclose(first, [4.0, 0.0, 8.0, 0.0])
    np.testing.assert_allclose(excused, [1.0, 0.0, 2.0, 0.0])
    third, excused = moved(100.0, 3)
    np.testing.assert_allclose(third, [4.0 * 0.49, 0.0, 8.0 * 0.49, 0.0])
    np.testing.assert_allclose(excused, [0.25, 0.0, 0.5, 0.0])


def test_far_from_the_agents_it_may_go_all_the_way_back():
    step, _ = moved(-30.0, 1, at=(31.0, 2.0))
    assert step[0] == pytest.approx(-30.0)


def test_small_corrections_and_squared_ranges_are_left_alone():
    step, excused = moved(0.01, 4)
    np.testing.assert_allclose(step, [0.01, 0.0, 0.02, 0.0], atol=1e-15)
    np.testing.assert_array_equal(excused, step)
    assert moved(100.0, -2)[0][0] == pytest.approx(100.0)
    assert moved(0.0, 1)[0].tolist() == [0.0] * 4


def test_without_damping_nothing_is_touched():
    before, after = np.array([[0.1, 0.2]]), np.array([[0.3, 0.7]])
    same, correction = corrected(None, before, after, 3)
    assert same is after
    np.testing.assert_array_equal(correction, after - before)


def test_agents_of_one_batch_have_passes_of_their_own():
    before = np.tile([1.0, 2.0, 0.0, 0.0], (2, 1))
    after, _ = DAMPING(before, before + np.array([[50.0, 0.0, 0.0, 0.0]]), np.array([1.0, 2.0]))
    np.testing.assert_allclose(after[:, 0] - 1.0, [4.0, 2.8])


def test_fixes_on_real_ranges_are_damped():
    def damping(*more):
        return Plan(load("tracking", [*more]).scenario).settings.damping

    assert damping() is None
    assert damping("sensor.real=true", "filter.defaults=22") is None
    two = "agents.count=2", "agents.positions=[[0,0,0],[3,4,0]]", "network.graph=complete"
    found = damping("sensor.real=true", *two)
    assert found is not None
    assert found.diagonal == pytest.approx(5.0)
    assert found.middle == pytest.approx((1.5, 2.0, 0.0))
