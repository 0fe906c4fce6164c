"""A constant that all recorded ranges have is told from the place of a target beside the agents."""

from __future__ import annotations

import numpy as np
import pytest

from tests.datasets.made import scenario_of, write_rows
from zenoh_cbef.simulator import simulate

ANCHORS = [(-15, -21, 20), (7, -15, 0), (-26, -20, 20), (23, -24, 0), (-12, -30, 20), (15, -20, 0), (2, -12, 20)]


def path(time):
    """A slow walk beside all anchors, (k, 3), m."""
    return np.stack(
        [18.0 - 0.15 * time, 9.0 - 0.05 * time + 0.5 * np.sin(0.2 * time), np.full_like(time, 3.0)], axis=-1
    )


def recorded(folder, seed):
    """Three ranges a second of each anchor, all of them three deviations too long."""
    random, rows = np.random.default_rng(seed), list[tuple[float, int, float]]()
    for number, anchor in enumerate(ANCHORS):
        time = np.arange(random.uniform(0.0, 0.3), 40.0, 0.3)
        ranges = np.linalg.norm(path(time) - anchor, axis=1) + 0.3 + 0.1 * random.normal(size=len(time))
        rows += [(t, number, r) for t, r in zip(time.tolist(), ranges.tolist(), strict=True)]
    times = np.arange(0.0, 40.0, 0.1)
    truth = [(t, *place) for t, place in zip(times.tolist(), path(times).tolist(), strict=True)]
    return write_rows(folder, ANCHORS, rows, truth)


def followed(sets, *more):
    """Position error, m, and NEES over its ideal, means over sets, after the first ten seconds."""
    off, sure = [], []
    for folder in sets:
        keys = "dt=0.1", "filter.range_std=0.1", "filter.planar_height=3", *more
        (trace,) = simulate([scenario_of(folder, *keys)])
        away = (trace.estimates - trace.truth)[0, 100:, :2]
        known = np.linalg.inv(trace.covariances[0, 100:, :2, :2])
        off.append(np.sqrt(np.nanmean(np.sum(away**2, axis=1))))
        sure.append(np.nanmean(np.einsum("ki,kij,kj->k", away, known, away)) / 2.0)
    return np.mean(off), np.mean(sure)


@pytest.fixture(scope="module")
def sets(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sets")
    return [recorded(folder / str(seed), seed) for seed in (1, 2, 3)]


def test_recorded_ranges_that_are_all_too_long_leave_agents_beside_the_target_honest(sets):
    former, today = (followed(sets, "filter.bias=estimate", f"filter.defaults={rules}") for rules in (27, 28))
    assert today[0] < 0.7 * former[0]
    assert today[1] < 1.0 < former[1]


def test_so_are_agents_that_do_not_know_yet_whether_there_is_a_bias(sets):
    former, today = (followed(sets, f"filter.defaults={rules}") for rules in (28, 29))
    assert today[0] < 0.9 * former[0]
    assert former[1] > 10.0
    assert today[1] < 2.0
