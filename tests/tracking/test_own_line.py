"""A line through an agent's ranges: right where single ranges are wrong, and silent where many are."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.tracking.filters.finding.own_line import OwnLine
from zenoh_cbef.tracking.filters.finding.remembered_ranges import Wandering
from zenoh_cbef.tracking.filters.finding.squared_ranges import Seen

LINE = OwnLine(0.1, Wandering(0.0, 1.0), 1e4)
AGES = 0.1 * np.arange(19, -1, -1.0)


def seen(ranges):
    return Seen(np.zeros((len(ranges), 20, 3)), np.broadcast_to(AGES, ranges.shape), ranges)


def ranges_of(place=100.0, rate=0.5, noise=0.1, runs=400):
    return place - rate * AGES + noise * np.random.default_rng(1).normal(size=(runs, 20))


def test_range_and_rate_are_as_sure_as_it_says():
    line, covariance, good = LINE.fitted(seen(ranges_of()), np.zeros(400))
    off = line - [100.0, 0.5]
    square = np.sum(off * np.linalg.solve(covariance, off[:, :, None])[:, :, 0], axis=1)
    assert square.mean() == pytest.approx(2.0, abs=0.4)
    assert good.all()


@pytest.mark.parametrize("wrong", [[3], [3, 19], [0, 7, 12, 19]])
def test_a_few_wrong_ranges_do_not_move_it(wrong):
    ranges = ranges_of()
    ranges[:, wrong] += 30.0
    line, _, _ = LINE.fitted(seen(ranges), np.zeros(400))
    assert np.abs(line[:, 0] - 100.0).mean() < 0.1


def test_missing_ranges_count_as_none():
    ranges = ranges_of()
    ranges[:, ::2] = np.nan
    line, covariance, good = LINE.fitted(seen(ranges), np.zeros(400))
    fewer = OwnLine(0.1, Wandering(0.0, 1.0), 1e4).fitted(
        Seen(np.zeros((400, 10, 3)), np.broadcast_to(AGES[1::2], (400, 10)), ranges[:, 1::2]), np.zeros(400)
    )
    assert np.allclose(line, fewer[0])
    assert np.allclose(covariance, fewer[1])
    assert good.all()


def test_an_agent_without_ranges_or_with_many_wrong_ones_is_not_good():
    nothing, many = np.full((1, 20), np.nan), ranges_of(runs=1)
    many[:, ::3] += 30.0
    assert not LINE.fitted(seen(nothing), np.zeros(1))[2].any()
    assert not LINE.fitted(seen(many), np.zeros(1))[2].any()


def test_a_straight_way_past_an_agent_is_no_error():
    way = np.stack([-2.0 * AGES, np.full(20, 4.0)], axis=1)
    ranges = np.linalg.norm(way, axis=1)[None]
    line, covariance, good = LINE.fitted(seen(ranges), np.array([2.0]))
    assert good.all()
    assert abs(line[0, 0] - 4.0) < 2.0 * np.sqrt(covariance[0, 0, 0])
