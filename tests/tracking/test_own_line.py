"""A line through an agent's ranges: right where single ranges are wrong, and silent where many are."""

from __future__ import annotations

from itertools import combinations, product
from statistics import median

import numpy as np
import pytest

from zenoh_cbef.tracking.filters.finding.own_line import FASTEST, OwnLine
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


def fitted(line, ages, ranges, speed):
    """What the docstring says of one agent, of the ranges that it has: line, covariance, share of the weight."""
    there = np.flatnonzero(np.isfinite(ranges))
    ages, ranges, pairs = ages[there], ranges[there], list(combinations(range(len(there)), 2))
    slopes = [(ranges[b] - ranges[a]) / (ages[a] - ages[b]) for a, b in pairs]
    rate = median(slopes) if slopes else 0.0
    place = median(ranges + rate * ages)
    bend = 0.5 * speed**2 / max(abs(place), 10.0 * line.noise) * ages**2
    noise = np.outer(bend, bend)
    for a, b in product(range(len(there)), repeat=2):
        short, long = sorted((ages[a], ages[b]))
        noise[a, b] += line.wandering.power * (short**2 * long / 2.0 - short**3 / 6.0)
    off = ranges - place + rate * ages
    level = 3.0 * np.sqrt(np.diag(noise) + line.noise**2)
    weight = np.minimum(1.0, level / np.maximum(np.abs(off), 1e-300)) ** 2
    noise += np.diag(line.noise**2 / weight)
    rows = np.column_stack([np.ones(len(ages)), -ages])
    gain = rows.T @ np.linalg.inv(noise)
    covariance = np.linalg.inv(gain @ rows + np.diag([line.far**-2, FASTEST**-2]))
    return covariance @ gain @ ranges, covariance, weight.mean()


@pytest.mark.parametrize("speed", [0.0, 6.0])
def test_it_is_generalised_least_squares_with_robust_weights(speed):
    """Of many ranges and few, an even number and an odd one, with and without wrong ones, far away and near."""
    line, random = OwnLine(0.1, Wandering(0.02, 1.0), 50.0), np.random.default_rng(7)
    ranges = np.concatenate([ranges_of(runs=8), ranges_of(place=0.4, rate=-0.3, runs=4)])
    for run, missing in enumerate((0, 1, 10, 11, 17, 18, 19, 4, 0, 5, 12, 13)):
        ranges[run, random.permutation(20)[:missing]] = np.nan
    ranges[[0, 1, 2, 7], 3] += [5.0, -0.5, 2.0, 30.0]
    ranges[0, [9, 12, 14, 16]] -= 0.45
    found, covariance, good = line.fitted(seen(ranges), np.full(len(ranges), speed))
    for run, own in enumerate(ranges):
        expected = fitted(line, AGES, own, speed)
        np.testing.assert_allclose(found[run], expected[0], rtol=1e-6)
        np.testing.assert_allclose(covariance[run], expected[1], rtol=1e-6)
        assert good[run] == (expected[2] >= 0.75)


def test_without_ranges_it_knows_what_it_knew_before():
    found, covariance, _ = LINE.fitted(seen(np.full((1, 20), np.nan)), np.zeros(1))
    assert not found.any()
    np.testing.assert_allclose(covariance[0], np.diag([LINE.far**2, FASTEST**2]), rtol=1e-6)
