"""Pairs of points that are near, found by cells, are those that a comparison of all pairs finds."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.tracking import near as nearness
from zenoh_cbef.tracking.graph import components, neighbours
from zenoh_cbef.tracking.near import pairs_within


@pytest.mark.parametrize("count", [1, 2, 50, 400])
@pytest.mark.parametrize("radius", [1e-9, 0.1, 0.3, 2.0, 100.0])
@pytest.mark.parametrize("scale", [(1, 1, 1), (1, 1, 0), (0, 0, 0), (50, 1, 1e-3)])
def test_pairs_are_all_that_are_near(count, radius, scale):
    points = np.random.default_rng(count).random((count, 3)) * scale
    first, second = np.triu_indices(count, 1)
    near = np.sum((points[first] - points[second]) ** 2, axis=1) <= radius * radius
    assert pairs_within(points, radius).tolist() == np.stack([first[near], second[near]], axis=1).tolist()


@pytest.mark.parametrize("at_once", [1, 3, 50])
def test_pairs_are_the_same_however_many_are_compared_at_once(monkeypatch, at_once):
    points = np.random.default_rng(3).random((60, 3))
    expected = pairs_within(points, 0.3).tolist()
    many, repeat = list[int](), np.repeat

    def counted(*what):
        found = repeat(*what)
        many.append(len(found))
        return found

    monkeypatch.setattr(nearness, "_AT_ONCE", at_once)
    monkeypatch.setattr(np, "repeat", counted)
    assert pairs_within(points, 0.3).tolist() == expected
    assert len(many) > 2 * 27
    assert max(many) <= at_once + 60


def test_components_are_ascending_and_sorted_by_their_least_member():
    path = np.array([[5, 3], [3, 8], [8, 0], [1, 4], [6, 7]])
    assert components(10, path) == [[0, 3, 5, 8], [1, 4], [2], [6, 7], [9]]
    assert components(2, np.empty((0, 2), dtype=np.int64)) == [[0], [1]]
    count = 2000
    order = np.random.default_rng(1).permutation(count)
    assert components(count, np.stack([order[:-1], order[1:]], axis=1)) == [list(range(count))]


def test_neighbours_are_ascending_and_padded_with_the_agent_itself():
    found = neighbours(4, np.array([[2, 0], [0, 1]]))
    assert found.index.tolist() == [[1, 2], [0, 1], [0, 2], [3, 3]]
    assert found.present.tolist() == [[True, True], [True, False], [True, False], [False, False]]
