"""Where a filter begins that is not told the noise of recorded ranges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests import unaided
from zenoh_cbef.datasets import Dataset, dataset_folder, read_dataset
from zenoh_cbef.datasets.scatter import scatter
from zenoh_cbef.datasets.spikes import without_spikes
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate


def recording(std, *, outliers=0.0, count=4000):
    """Ranges of two anchors at uneven times, of a target on a straight line, with biases of 5 m."""
    random = np.random.default_rng(3)
    time = np.sort(random.uniform(0.0, 400.0, count))
    anchor = random.integers(0, 2, count)
    ranges = 20.0 + 0.4 * time + 5.0 * anchor + std * random.normal(size=count)
    ranges += np.where(random.random(count) < outliers, 30.0, 0.0)
    return Dataset(("0", "1"), np.eye(2, 3), time, anchor, ranges, np.empty(0), np.empty((0, 3)))


@pytest.mark.parametrize("std", [0.02, 1.5])
def test_it_is_the_noise_of_ranges_whatever_they_have_in_common_and_in_spite_of_outliers(std):
    assert scatter(recording(std)) == pytest.approx(std, rel=0.05)
    assert scatter(recording(std, outliers=0.05)) == pytest.approx(std, rel=0.25)


def test_too_few_ranges_say_nothing():
    assert scatter(recording(0.1, count=12)) is None


def test_about_ranges_further_apart_it_shows_errors_that_last_and_no_more_of_others():
    made = recording(0.1)
    assert scatter(made, 3) == pytest.approx(0.1, rel=0.05)
    lasting = np.empty_like(made.ranges)
    for anchor in (0, 1):
        own, random = made.range_anchor == anchor, np.random.default_rng(anchor)
        lasting[own] = 0.2 * np.cumsum(random.normal(size=int(own.sum())))
    slow = replace(made, ranges=made.ranges + lasting)
    assert (scatter(slow, 3) or 0.0) > 1.25 * (scatter(slow) or 1.0)


def test_a_network_that_is_not_told_the_noise_begins_there_at_least():
    told, made = ["filter.range_std=auto"], read_dataset(dataset_folder("recorded:lawnmower"))

    def begun(*more):
        return load("lawnmower", [*told, *more]).scenario.sensor.range_std

    assert begun() == begun("sensor.range_std=0.3") == scatter(without_spikes(made), 3)
    assert begun("filter.defaults=20") == scatter(made, 3)
    assert begun("sensor.range_std=5.0") == 5.0
    assert begun("filter.defaults=11") == scatter(made)
    assert begun("sensor.range_std=0.3", "filter.defaults=11") == 0.3
    assert load("lawnmower").scenario.sensor.range_std == 0.1


@pytest.mark.slow
def test_a_noise_of_twice_what_it_is_hides_no_bias():
    errors = [
        unaided.position_rmse(unaided.errors(simulate([load("lawnmower", keys).scenario]))[0])
        for keys in (["filter.range_std=3.0"], ["filter.range_std=3.0", "filter.defaults=11"], [])
    ]
    assert errors[0] < 0.5 * errors[1]
    assert errors[1] > 2.0 * errors[2]


@pytest.mark.slow
def test_a_noise_that_is_learned_costs_less_than_a_tenth():
    found, given = (simulate([load("lawnmower", keys).scenario]) for keys in (["filter.range_std=auto"], []))
    learned, known = (unaided.position_rmse(unaided.errors(each)[0]) for each in (found, given))
    assert learned < 1.1 * known
