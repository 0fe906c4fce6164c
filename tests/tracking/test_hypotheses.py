"""Least squares without each receiver in turn: the one that is wrong is found, from wherever the search begins."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.finding import hypotheses
from zenoh_cbef.tracking.filters.finding.hypotheses import Hypotheses, Told, _Problem, belief_at, speed_of
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


def problem(middle):
    one = told(2)
    kept = np.vstack([np.ones((1, 6)), 1.0 - np.eye(6)])
    return one, kept, _Problem.of(Space(), one, kept, HYPOTHESES.anywhere[1], np.asarray(middle))


def test_a_search_begins_at_the_estimate_in_the_middle_and_at_the_mirror_image(monkeypatch):
    begun = []

    def lowest(self, state):
        begun.append(state)
        return state, self.at(state)[2]

    monkeypatch.setattr(_Problem, "lowest", lowest)
    middle, estimate = np.arange(6.0), np.array([[3.0, 1, 4, 1, 5, 9], [2.0, 6, 5, 3, 5, 8]])
    both = Told(*(np.concatenate([values, values]) for values in vars(told(2)).values()))
    Hypotheses(Space(), (middle, HYPOTHESES.anywhere[1])).all(both, estimate)
    [starts] = begun
    assert starts.shape == (2, 3, 7, 6)
    for run in range(2):
        for hypothesis in range(7):
            expected = [estimate[run], middle, 2.0 * middle - estimate[run]]
            np.testing.assert_array_equal(starts[run, :, hypothesis], expected)


@pytest.mark.parametrize("place", [[-2.4, -4.0, -0.7], PLACES[0] + 0.1], ids=["among", "beside one"])
def test_costs_are_those_of_the_formula_and_descents_are_their_slopes(place):
    one, kept, least = problem([1.0, 2, 3, 0.1, 0.2, 0.3])
    state = np.array([*place, 2.0, -1.3, 4.1])

    def cost(at, which):
        offset = at[:3] - PLACES
        distance = np.linalg.norm(offset, axis=1)
        off = one.lines[0] - np.stack([distance, offset @ at[3:] / distance], axis=1)
        ranges = sum(kept[which, agent] * off[agent] @ np.linalg.solve(COVARIANCE, off[agent]) for agent in range(6))
        away = at - least.middle
        return ranges + away @ (away / (1e4 * HYPOTHESES.anywhere[1]))

    descent, information, costs = least.at(np.broadcast_to(state, (1, 1, 7, 6)))
    for which in range(7):
        assert costs[0, 0, which] == pytest.approx(cost(state, which), rel=1e-9)
        slope = [(cost(state + step, which) - cost(state - step, which)) / 2e-5 for step in 1e-5 * np.eye(6)]
        np.testing.assert_allclose(-2.0 * descent[0, 0, which], slope, rtol=1e-4, atol=1e-2)
        np.testing.assert_allclose(information[0, 0, which], information[0, 0, which].T)
        assert np.linalg.eigvalsh(information[0, 0, which])[0] > 0.0


def test_a_target_at_a_receiver_has_no_direction_from_it():
    _, _, least = problem(np.zeros(6))
    for found in least.at(np.broadcast_to([*PLACES[0], 1.0, 1.0, 1.0], (1, 1, 7, 6))):
        assert np.isfinite(found).all()


def test_a_step_is_damped_by_a_thousandth_at_first_and_by_a_tenth_of_that_after_a_success(monkeypatch):
    _, _, least = problem(np.zeros(6))
    state = np.broadcast_to(TARGET + 0.1, (1, 1, 7, 6))
    expected, damping = state, 1e-3
    for count in (1, 2):
        monkeypatch.setattr(hypotheses, "_ITERATIONS", count)
        descent, information, cost = least.at(expected)
        damped = information * (1.0 + damping * np.eye(6))
        tried = expected + np.linalg.solve(damped, descent[..., None])[..., 0]
        assert (least.at(tried)[2] < cost).all()
        expected, damping = tried, 0.1 * damping
        found, costs = least.lowest(state)
        np.testing.assert_allclose(found, expected, rtol=1e-9)
        np.testing.assert_allclose(costs, least.at(expected)[2], rtol=1e-9)


def test_a_step_that_gains_nothing_is_not_taken_and_the_next_is_damped_more(monkeypatch):
    least = problem(np.zeros(6))[2]
    far = np.broadcast_to(np.array([0.3, 0.2, 60.0, 40.0, -30.0, 20.0]), (1, 1, 7, 6))
    costs = []
    for count in range(12):
        monkeypatch.setattr(hypotheses, "_ITERATIONS", count)
        state, cost = least.lowest(far)
        np.testing.assert_allclose(cost, least.at(state)[2])
        costs.append(cost)
    assert all((later <= before).all() for before, later in pairwise(costs))
    assert (costs[-1] < costs[0]).all()


def test_a_belief_allows_for_the_speed_of_its_mean_and_one_deviation_more():
    covariance = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])[None]
    belief = Belief(np.array([[9.0, 9.0, 9.0, 1.0, 2.0, 3.0]]), covariance)
    assert speed_of(belief, 3).tolist() == pytest.approx([np.sqrt(14.0 + 15.0)])
    flat = Belief(belief.state[:, [0, 1, 3, 4]], covariance[:, [0, 1, 3, 4]][:, :, [0, 1, 3, 4]])
    assert speed_of(flat, 2).tolist() == pytest.approx([np.sqrt(5.0 + 9.0)])
