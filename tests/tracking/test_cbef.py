"""The literal filter is the paper's, equation by equation."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.tracking.consensus import Average
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.filters.kinds.cbef import Cbef
from zenoh_cbef.tracking.graph import canonical_edges, neighbours
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space
from zenoh_cbef.tracking.tracker import Tracker
from zenoh_cbef.tracking.weights import uniform_weights


class PaperAgent:
    """One agent of the paper in plain Python; a state is a list of positions, then velocities."""

    def __init__(self, state, position, height):
        self.state = state
        self.position = position
        self.height = height
        self.innovation = self.gain = math.nan

    def predict(self, dt):
        axes = len(self.state) // 2
        position = [self.state[a] + dt * self.state[axes + a] for a in range(axes)]
        self.state = position + self.state[axes:]

    def update(self, own, heard, xi):
        """Heard: a list of (position, range) of the neighbours that delivered theirs."""
        axes = len(self.state) // 2
        rows, innovation = [], []
        for other, distance in heard if own is not None else []:
            row = [other[a] - self.position[a] for a in range(3)]
            right = own**2 - distance**2 + sum(c**2 for c in other) - sum(c**2 for c in self.position)
            right /= 2.0
            if self.height is not None:
                right -= row[2] * self.height
            rows.append(row[:axes])
            innovation.append(right - sum(row[a] * self.state[a] for a in range(axes)))
        if not rows:
            self.innovation = self.gain = math.nan
            return
        self.innovation = math.sqrt(sum(z**2 for z in innovation))
        self.gain = 1.0 if self.innovation <= xi else xi / self.innovation
        for a in range(axes):
            self.state[a] += self.gain * sum(row[a] * z for row, z in zip(rows, innovation, strict=True))


def paper_consensus(agents, lists, epsilon, rounds):
    for _ in range(rounds):
        before = [list(agent.state) for agent in agents]
        for number, agent in enumerate(agents):
            for component in range(len(agent.state)):
                pull = sum(before[number][component] - before[other][component] for other in lists[number])
                agent.state[component] = before[number][component] - epsilon * pull


def draw_graph(chance, count):
    pairs = [(first, second) for first in range(count) for second in range(first + 1, count)]
    return canonical_edges([pair for pair in pairs if chance.random() < 0.6])


@settings(deadline=None, derandomize=True, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.sampled_from([None, 0.3]), st.sampled_from([0.05, 1.0, 1e6]))
def test_several_steps_are_the_equations_computed_by_loops(seed, height, xi):
    chance = random.Random(seed)  # noqa: S311
    count, dt, rounds, axes = 5, 0.1, 3, 3 if height is None else 2
    lists = neighbours(count, draw_graph(chance, count))
    plain_lists = [lists.row(agent).index[0].tolist() for agent in range(count)]
    epsilon = 1.0 / (lists.degree.max() + 1.0)
    states = [[chance.gauss(0, 1) for _ in range(2 * axes)] for _ in range(count)]
    places = [[chance.random() for _ in range(3)] for _ in range(count)]
    agents = [PaperAgent(list(state), place, height) for state, place in zip(states, places, strict=True)]
    space = Space(height)
    tracker = Tracker(
        Cbef(NearlyConstantVelocity(dt, 0.1, axes), space, xi),
        Average(uniform_weights(lists, epsilon)),
        space,
        Belief(np.array(states), None),
    )
    for _ in range(4):
        ranges = [None if chance.random() < 0.2 else 1.0 + chance.random() for _ in range(count)]
        for number, agent in enumerate(agents):
            agent.position = [place + 0.1 * chance.random() for place in places[number]]
        for number, agent in enumerate(agents):
            heard = [(agents[o].position, ranges[o]) for o in plain_lists[number] if ranges[o] is not None]
            agent.predict(dt)
            agent.update(ranges[number], heard, xi)
        updates = [(agent.innovation, agent.gain) for agent in agents]
        paper_consensus(agents, plain_lists, epsilon, rounds)

        positions = np.array([agent.position for agent in agents])
        measured = np.array([math.nan if one is None else one for one in ranges])
        heard_ranges = np.where(lists.present, measured[lists.index], np.nan)
        message = tracker.measure(
            Measurement(positions, measured, np.zeros(count), positions[lists.index], heard_ranges)
        )
        for _ in range(rounds):
            message = tracker.exchange(message[lists.index], None)
        estimate = tracker.conclude()
        expected = np.array([agent.state for agent in agents])
        kept = space.kept
        np.testing.assert_allclose(estimate.state[:, kept], expected, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(estimate.diagnostics.innovation, [one for one, _ in updates], rtol=1e-9)
        np.testing.assert_allclose(estimate.diagnostics.weight, [one for _, one in updates], rtol=1e-9)
        assert estimate.covariance is None
        if height is not None:
            assert (estimate.state[:, 2] == height).all()


def make(xi, dt=0.5):
    return Cbef(NearlyConstantVelocity(dt, 0.1), Space(), xi)


def measurement(neighbour_range):
    return Measurement(
        position=np.zeros((1, 3)),
        range=np.array([1.0]),
        age=np.zeros(1),
        neighbour_position=np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]),
        neighbour_range=np.array([neighbour_range]),
    )


@pytest.mark.parametrize("xi", [0.01, 0.3, 0.7, 50.0])
def test_saturation_is_by_the_norm_of_the_whole_innovation(xi):
    # At the origin and at rest the innovation is y = ((1 - 0.64 + 1)/2, (1 - 1.44 + 1)/2) = (0.68, 0.28).
    update = make(xi).update(Belief(np.zeros((1, 6)), None), measurement([0.8, 1.2]))
    size = math.hypot(0.68, 0.28)
    gain = min(1.0, xi / size)
    assert update.diagnostics.innovation[0] == pytest.approx(size)
    assert update.diagnostics.weight[0] == pytest.approx(gain)
    np.testing.assert_allclose(update.payload, [[gain * 0.68, gain * 0.28, 0.0, 0.0, 0.0, 0.0]], atol=1e-15)


def test_the_velocity_is_never_corrected():
    state = np.array([[0.1, 0.2, 0.3, 4.0, 5.0, 6.0]])
    update = make(1.0).update(Belief(state, None), measurement([0.8, 1.2]))
    assert update.payload[0, 3:].tolist() == [4.0, 5.0, 6.0]


def test_an_agent_that_hears_nothing_predicts_only():
    state = np.array([[0.1, 0.2, 0.3, 4.0, 5.0, 6.0]])
    update = make(1.0).update(Belief(state, None), measurement([np.nan, np.nan]))
    np.testing.assert_allclose(update.payload, [[2.1, 2.7, 3.3, 4.0, 5.0, 6.0]], rtol=1e-15)
    assert np.isnan(update.diagnostics.innovation).all()
    assert np.isnan(update.diagnostics.weight).all()


def test_an_innovation_of_zero_is_not_saturated():
    state = np.array([[0.68, 0.28, 0.0, 0.0, 0.0, 0.0]])
    update = make(1e-9).update(Belief(state, None), measurement([0.8, 1.2]))
    assert update.diagnostics.weight.tolist() == [1.0]
    np.testing.assert_allclose(update.payload, state, atol=1e-14)
