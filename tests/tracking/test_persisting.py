"""A range that was wrong is rather wrong again, and by as much."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.stress import cases, heard_by, scenario_of
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters.models.persisting import again, judged
from zenoh_cbef.tracking.filters.models.slots import Slots
from zenoh_cbef.tracking.outliers import UNTOLD
from zenoh_cbef.tracking.ranging import Space

AGAIN, AS_MUCH = 0.1, 0.5
SWIFT = "dt=0.3", "target.motion=lemniscate", "target.radius=3", "target.period=2"
SIZE = 5.0


def plainly(innovation, variance):
    """Logarithms of how likely a range is right, or wrong, whatever the range before it was."""
    share = UNTOLD[0]
    right = np.log1p(-share) - 0.5 * (innovation**2 / variance + np.log(2.0 * np.pi * variance))
    return right, np.log(0.5 * share / SIZE) - np.abs(innovation) / SIZE


def after(innovation, variance, chance, error, spread):
    """The same after a range that was as likely wrong as that, by an error of a variance."""
    innovation = np.atleast_2d(np.asarray(innovation, dtype=float))
    former = np.broadcast_to(np.array([chance, error, spread]), (*innovation.shape, 3))
    told = innovation, np.full_like(innovation, variance)
    return plainly(*told), again(plainly(*told), told, former)


@given(st.floats(0.01, 1.0), st.floats(-30.0, 30.0), st.floats(1e-3, 10.0), st.floats(1e-3, 10.0))
def test_what_is_likely_after_a_wrong_range_adds_up_to_one(chance, error, variance, spread):
    width = np.sqrt(variance + spread)
    beside = np.concatenate([np.linspace(-400.0, 400.0, 8001), error + width * np.linspace(-9, 9, 2001), [0.0]])
    right_near = np.sqrt(variance) * np.linspace(-9, 9, 2001)
    where = np.unique(np.concatenate([beside, right_near]))
    _, (right, wrong) = after(where, variance, chance, error, spread)
    likely = UNTOLD[0] + chance * (AGAIN - UNTOLD[0])
    assert np.trapezoid(np.exp(right[0]), where) == pytest.approx(1.0 - likely, rel=1e-3)
    assert np.trapezoid(np.exp(wrong[0]), where) == pytest.approx(likely, rel=1e-3)


@given(st.floats(-60.0, 60.0), st.floats(1e-4, 100.0), st.floats(-30.0, 30.0), st.floats(1e-4, 100.0))
def test_after_a_right_range_everything_is_as_likely_to_the_last_bit(innovation, variance, error, spread):
    former, told = after(innovation, variance, 0.0, error, spread)
    np.testing.assert_array_equal(former, told)


def test_the_same_error_again_is_far_likelier_than_another_one():
    _, (_, wrong) = after([10.0, 14.0], 0.02, 1.0, 10.0, 0.02)
    # Half of a normal density of the variance .04 at its peak, beside half of that of any wrong range.
    peak, any_ = 1.0 / np.sqrt(2.0 * np.pi * 0.04), np.exp(-10.0 / SIZE) / (2.0 * SIZE)
    assert np.exp(wrong[0, 0]) == pytest.approx(AGAIN * (AS_MUCH * peak + (1.0 - AS_MUCH) * any_))
    assert np.exp(wrong[0, 1]) == pytest.approx(AGAIN * (1.0 - AS_MUCH) * np.exp(-14.0 / SIZE) / (2.0 * SIZE))


def six(*wrong, missing=()):
    """What one hypothesis makes of six ranges, some of them wrong for sure, as likely as anything, or missing."""
    likely = np.zeros((2, 1, 1, 6))
    likely[0, ..., list(wrong)] = -800.0
    likely[1] = -4.0
    errors = np.stack([np.full((1, 1, 6), 10.0), np.full((1, 1, 6), 0.5)])
    there = ~np.isin(np.arange(6), missing)[None, None]
    return judged(likely, errors, there, 3)[0, 0]


def test_ranges_count_for_wrong_where_the_others_prove_the_place():
    np.testing.assert_array_equal(six(1, 4)[:, 0], [0, 1, 0, 0, 1, 0])
    np.testing.assert_array_equal(six(1, 4)[1], [1.0, 10.0, 0.5])
    assert not six(1, 4, 5)[:, 0].any()  # Three right ranges fit some place whatever they are.
    assert not six(1, 4, missing=[0])[:, 0].any()
    assert six(1, missing=[0, 1])[1].tolist() == [0.0, 0.0, 1.0]


def test_only_steps_are_looked_back_at_in_which_a_range_does_not_fit():
    slots, state = Slots(Space(), 0.1, (0.0, 0.0, 0.0), 3), np.zeros((2, 6))
    state[1, 0] = 0.6
    places = np.broadcast_to(np.array([[3.0, 0, 0], [0, 4, 0], [0, 0, 5]]), (2, 3, 3))
    ranges = np.array([[3.1, 4.0, np.nan], [3.1, 4.0, np.nan]])
    heard = slots.at(places, ranges, np.zeros((2, 3)), np.full((2, 3), 0.01))
    np.testing.assert_array_equal(slots.doubtful(heard, state).range, [[np.nan] * 3, [3.1, 4.0, np.nan]])
    assert np.isnan(slots.nothing(state).range).all()


@pytest.mark.parametrize("seed", [1038, 1046])
def test_two_receivers_that_are_wrong_for_long_do_not_prove_another_place(seed):
    """Of six, in steps in which the target may get anywhere: with a right one they fit the mirror image of the rest."""
    errors = []
    for rules in (25, 24):
        scenario = scenario_of(cases()["fast-lemniscate-and-bursts"], [f"filter.defaults={rules}", f"seed={seed}"])
        trace = simulate([scenario], heard=[heard_by(Plan(scenario), "bursts")])[0]
        errors.append(np.linalg.norm((trace.estimates - trace.truth)[:, 75:, :3], axis=2))
    today, before = (float(np.sqrt(np.mean(one**2))) for one in errors)
    assert today < 0.6
    assert before > 2.0


def test_what_a_scenario_tells_of_outliers_goes_before():
    told = *SWIFT, "sensor.outlier_probability=0.1", "sensor.outlier_scale=3", "steps=20"
    scenarios = [load("tracking", [*told, f"filter.defaults={rules}"]).scenario for rules in (25, 24)]
    today, before = (simulate([scenario])[0].estimates for scenario in scenarios)
    np.testing.assert_array_equal(today, before)
