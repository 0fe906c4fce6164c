"""Least squares without each receiver in turn: the one that is wrong is found, from wherever the search begins."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.tracking.filters.around.hypotheses import Hypotheses, Told, belief_at
from zenoh_cbef.tracking.ranging import Space

PLACES = np.array([[-8.0, 3, 1], [7, -6, 4], [2, 9, -5], [-3, -7, -8], [9, 5, 7], [-6, 1, 9]])
TARGET = np.array([1.0, -2.0, 0.5, 0.4, 0.3, -0.2])
COVARIANCE = np.diag([0.05, 0.05]) ** 2
HYPOTHESES = Hypotheses(Space(), (np.zeros(6), np.array([170.0, 170, 170, 3, 3, 3]) ** 2))


def told(wrong=None, off=3.0, agents=6):
    offset = TARGET[:3] - PLACES[:agents]
    distance = np.linalg.norm(offset, axis=1)
    lines = np.stack([distance, offset @ TARGET[3:] / distance], axis=1)
    lines += 0.05 * np.random.default_rng(3).normal(size=lines.shape)
    if wrong is not None:
        lines[wrong, 0] += off
    return Told(
        np.ones((1, agents)), PLACES[None, :agents], lines[None], np.broadcast_to(COVARIANCE, (1, agents, 2, 2))
    )


@pytest.mark.parametrize("wrong", range(6))
@pytest.mark.parametrize("start", [[0.0, 0, 0, 0, 0, 0], [30.0, -20, 10, 1, 1, 1]])
def test_the_wrong_receiver_is_found(wrong, start):
    found = HYPOTHESES.all(told(wrong), np.array([start]))
    assert found.cost[0].argmin() == wrong + 1
    assert found.cost[0, 0] - found.cost[0, wrong + 1] > 100.0
    place = belief_at(found, np.array([wrong + 1.0]))
    off = place.state[0] - TARGET
    assert off @ np.linalg.solve(place.known_covariance[0], off) < 25.0


def test_where_none_is_wrong_little_is_gained_and_costs_are_as_they_should_be():
    found = HYPOTHESES.all(told(), TARGET[None])
    assert found.cost[0, 0] - found.cost[0, 1:].min() < 13.5
    assert found.cost[0, 0] < 4.0 * found.spare[0, 0]
    assert found.spare[0].tolist() == [6.0, *[4.0] * 6]


def test_an_agent_that_told_nothing_counts_for_nothing():
    all_but_one, five = told(), told(agents=5)
    silent = np.array([[1.0, 1, 1, 1, 1, 0]])
    fewer = Told(silent, all_but_one.positions, all_but_one.lines, all_but_one.covariance)
    found = HYPOTHESES.all(fewer, TARGET[None])
    assert found.spare[0, 0] == 4.0
    assert found.cost[0, 6] == pytest.approx(found.cost[0, 0])
    assert len(five.known[0]) == 5


def test_a_network_finds_the_same_alone_and_beside_others():
    one, two = told(1), told(4)
    both = Told(*(np.concatenate(pair) for pair in zip(vars(one).values(), vars(two).values(), strict=True)))
    together = HYPOTHESES.all(both, np.zeros((2, 6)))
    for run, alone in enumerate((one, two)):
        mine = HYPOTHESES.all(alone, np.zeros((1, 6)))
        assert mine.state[0].tobytes() == together.state[run].tobytes()
        assert mine.cost[0].tobytes() == together.cost[run].tobytes()
