"""The exact bootstrap interval against resampling, and what holds for any sample."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from zenoh_cbef.experiment.statistics import median_interval

NUMBERS = st.floats(-1e6, 1e6, allow_nan=False)


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, 7, 15, 51])
def test_for_odd_numbers_the_interval_is_what_resampling_tends_to(count):
    values = np.random.default_rng(count).normal(size=count) ** 3
    resampled = np.random.default_rng(1).choice(values, size=(200_000, count))
    medians = np.sort(np.median(resampled, axis=1))
    found = median_interval(values.tolist())
    # A value of the sample is a step of the bootstrap distribution: the share below it and up to it enclose 2.5 %.
    for bound, share in ((found.low, 0.025), (found.high, 0.975)):
        below = np.searchsorted(medians, bound, side="left") / len(medians)
        upto = np.searchsorted(medians, bound, side="right") / len(medians)
        assert below - 0.002 <= share <= upto + 0.002


@pytest.mark.parametrize("count", [4, 10, 50])
def test_for_even_numbers_the_interval_encloses_the_resampled_one(count):
    values = np.random.default_rng(count).normal(size=count)
    medians = np.median(np.random.default_rng(2).choice(values, size=(50_000, count)), axis=1)
    found = median_interval(values.tolist())
    assert found.low <= np.quantile(medians, 0.03)
    assert found.high >= np.quantile(medians, 0.97)


def test_the_interval_covers_the_true_median_about_as_often_as_it_says():
    draws = np.random.default_rng(5).exponential(size=(2000, 41))
    found = [median_interval(row.tolist()) for row in draws]
    covered = np.mean([one.low <= np.log(2.0) <= one.high for one in found])
    assert 0.92 <= covered <= 0.98


@given(st.lists(NUMBERS, min_size=1, max_size=200))
@examples(60)
def test_the_interval_is_made_of_values_around_the_median_in_any_order(values):
    found = median_interval(values)
    assert found.low <= found.median <= found.high
    assert {found.low, found.high} <= set(values)
    assert found == median_interval(values[::-1])
    moved = median_interval([-value for value in values])
    assert (moved.low, moved.high) == (-found.high, -found.low)


@given(st.integers(5, 60), st.integers(1, 8))
@examples(25)
def test_more_runs_of_the_same_values_are_surer(count, times):
    values = list(map(float, range(count)))
    once, often = median_interval(values), median_interval(values * (2 * times + 1))
    assert often.high - often.low <= once.high - once.low
