"""How fast a recorded target changes its velocity, from its ranges alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.datasets import Dataset, dataset_folder, read_dataset
from zenoh_cbef.datasets.agility import agility
from zenoh_cbef.datasets.first_scenario import time_step
from zenoh_cbef.datasets.scatter import scatter
from zenoh_cbef.datasets.spikes import without_spikes

INTERVAL = 0.1


def recording(quick, std=0.1, *, outliers=0.0, seconds=200.0):
    """Ranges, along a line, to a target that has another acceleration, of this deviation, in every interval."""
    random, count = np.random.default_rng(4), int(seconds / INTERVAL)
    pushes = quick * random.normal(size=count)
    speed = np.cumsum(pushes) * INTERVAL
    way = np.cumsum(speed) * INTERVAL - 0.5 * pushes * INTERVAL**2
    noise = std * random.normal(size=count) + np.where(random.random(count) < outliers, 30.0, 0.0)
    ranges = np.asarray(1e4 + way + noise, dtype=np.float64)
    time = np.asarray(INTERVAL * np.arange(count), dtype=np.float64)
    return Dataset(("0",), np.zeros((1, 3)), time, np.zeros(count, dtype=int), ranges, np.empty(0), np.empty((0, 3)))


@pytest.mark.parametrize("quick", [0.3, 1.0, 6.0])
@pytest.mark.parametrize("std", [0.02, 0.3])
def test_it_is_the_acceleration_of_the_target_whatever_the_noise_and_in_spite_of_outliers(quick, std):
    assert agility(recording(quick, std)) == pytest.approx(quick, rel=0.35)
    assert agility(recording(quick, std, outliers=0.03)) == pytest.approx(quick, rel=0.5)


def test_of_many_outliers_single_ranges_are_left_out_first():
    """Of ranges of which a fifth is wrong half of all lines through three have a wrong one."""
    wrong = recording(1.0, outliers=0.2)
    assert not 0.5 < (agility(wrong) or 0.0) < 2.0
    assert (scatter(wrong) or 0.0) > 0.2
    assert 0.5 < (agility(without_spikes(wrong)) or 0.0) < 2.0
    assert scatter(without_spikes(wrong)) == pytest.approx(0.1, rel=0.15)


def test_ranges_that_are_right_are_kept():
    clean = recording(1.0)
    left = without_spikes(clean)
    assert len(left.ranges) > 0.98 * len(clean.ranges)
    assert np.isin(left.range_time, clean.range_time).all()
    still = replace(clean, ranges=np.full_like(clean.ranges, 7.0))
    assert len(without_spikes(still).ranges) == len(still.ranges)
    few = replace(clean, **{key: getattr(clean, key)[:5] for key in ("range_time", "range_anchor", "ranges")})
    assert len(without_spikes(few).ranges) == 5


def test_a_target_that_goes_straight_on_has_little():
    assert (agility(recording(0.0)) or 0.0) < 0.1


def test_too_few_ranges_say_nothing():
    assert agility(recording(1.0, seconds=2.0)) is None


def test_steps_are_shorter_where_a_target_turns_within_them():
    assert time_step(recording(0.3)) == INTERVAL
    assert time_step(recording(8.0)) == INTERVAL / 2.0
    assert time_step(recording(100.0, std=0.001)) == INTERVAL / 4.0
    assert time_step(read_dataset(dataset_folder("recorded:lawnmower"))) == 0.5
