"""Where a filter begins that learns the noise of recorded ranges."""

from __future__ import annotations

import numpy as np
import pytest

from tests import unaided
from zenoh_cbef.datasets import Dataset, dataset_folder, read_dataset
from zenoh_cbef.datasets.scatter import scatter
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


def test_a_learning_network_begins_there_unless_it_is_told_where():
    told = ["filter.range_std=auto"]
    begun = load("lawnmower", told).scenario.sensor.range_std
    assert begun == scatter(read_dataset(dataset_folder("recorded:lawnmower")))
    assert load("lawnmower", [*told, "sensor.range_std=0.3"]).scenario.sensor.range_std == 0.3
    assert load("lawnmower").scenario.sensor.range_std == 0.1


@pytest.mark.slow
def test_a_noise_that_is_learned_costs_less_than_a_tenth():
    found, given = (simulate([load("lawnmower", keys).scenario]) for keys in (["filter.range_std=auto"], []))
    learned, known = (unaided.position_rmse(unaided.errors(each)[0]) for each in (found, given))
    assert learned < 1.1 * known
