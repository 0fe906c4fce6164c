"""How fast a recorded target is, from its ranges alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.datasets import Dataset
from zenoh_cbef.datasets.scatter import growing, scatter
from zenoh_cbef.datasets.speed import speed
from zenoh_cbef.datasets.spikes import without_spikes

ANCHORS = np.array([[-20.0, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]])


def recording(way, *, every=0.1, std=0.1, outliers=0.0, seconds=200.0):
    """Ranges of four anchors, each at times of its own, of a target at way(t), (k, 2)."""
    random, parts = np.random.default_rng(3), []
    for number, anchor in enumerate(ANCHORS[:, :2]):
        time = np.arange(random.uniform(0.0, every), seconds, every)
        noise = std * random.normal(size=len(time)) + np.where(random.random(len(time)) < outliers, 15.0, 0.0)
        ranges = np.linalg.norm(way(time) - anchor, axis=1) + noise
        parts.append(np.stack([time, np.full(len(time), number), ranges], axis=1))
    rows = np.concatenate(parts)
    time, number, ranges = rows[np.argsort(rows[:, 0], kind="stable")].T
    known = np.empty(0), np.empty((0, 3))
    return Dataset(tuple("0123"), ANCHORS, time, number.astype(np.intp), np.ascontiguousarray(ranges), *known)


def round_and_round(fast):
    """On a circle of 5 m, at this speed, m/s."""
    return lambda time: 5.0 * np.stack([np.cos(fast * time / 5.0), np.sin(fast * time / 5.0)], axis=1)


def to_and_fro(time):
    """At 2 m/s along a line of 4 m, back as soon as its end is reached."""
    return np.stack([np.abs((2.0 * time) % 8.0 - 4.0), 0.3 * np.abs((2.0 * time) % 8.0 - 4.0)], axis=1)


@pytest.mark.parametrize("fast", [0.1, 1.0, 5.0])
@pytest.mark.parametrize("std", [0.01, 0.1])
def test_it_is_that_along_an_axis_whatever_the_noise_and_in_spite_of_outliers(fast, std):
    along = fast / np.sqrt(2.0)
    assert speed(recording(round_and_round(fast), std=std)) == pytest.approx(along, rel=0.3)
    late = without_spikes(recording(round_and_round(fast), std=std, outliers=0.1))
    assert speed(late) == pytest.approx(along, rel=0.4)


def test_rare_ranges_scatter_by_the_motion_and_a_told_noise_limits_that():
    """Between two ranges the target is nearly back where it was: what it seems to be is half as fast as it is."""
    rare = recording(to_and_fro, every=1.5)
    assert (scatter(rare) or 0.0) > 5.0 * 0.1
    assert speed(rare) is None
    assert speed(rare, 0.2) == pytest.approx(speed(recording(to_and_fro)), rel=0.5)


def test_a_target_at_rest_and_few_ranges_say_nothing():
    assert speed(recording(lambda time: np.ones((len(time), 2)))) is None
    few = recording(round_and_round(1.0), seconds=0.5)
    assert speed(few) is None
    one = {key: getattr(few, key)[:1] for key in ("range_time", "range_anchor", "ranges")}
    assert speed(replace(few, **one)) is None


def test_what_shows_in_a_few_long_spans_alone_is_no_speed():
    assert speed(recording(round_and_round(1.0), std=0.15, seconds=1.0)) is None
    assert speed(recording(round_and_round(1.0), std=0.15)) is not None


def test_spans_grow_by_a_quarter():
    assert [*growing(1, 8)] == [1, 2, 3, 4, 5, 6, 7, 8]
    assert [*growing(4, 22)] == [4, 5, 6, 7, 8, 10, 12, 15, 18, 22]
    assert not [*growing(9, 8)]
