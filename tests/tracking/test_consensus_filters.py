"""ci, hcmci, kcf and diffusion are their papers' equations, and the centralised filter where the papers say so."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.tracking.consensus import Average
from zenoh_cbef.tracking.filters import Belief, FilterSettings, make_filter, sharing_of
from zenoh_cbef.tracking.graph import make_edges, neighbours
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space
from zenoh_cbef.tracking.tracker import Tracker
from zenoh_cbef.tracking.weights import metropolis_weights, uniform_weights, weight_matrix

STD, DT, XI, EPSILON = 0.3, 0.2, 1.5, 0.15
SPACES = st.sampled_from([Space(), Space(0.7)])
SEEDS = st.integers(0, 2**32 - 1)


class Network:
    """Random agents, and the same agents in plain NumPy, one at a time."""

    def __init__(self, kind, space, seed, *, count=5, graph="erdos-renyi", omega=None, together=False):
        self.random = np.random.default_rng(seed)
        self.kind, self.space, self.count = kind, space, count
        edges = make_edges(graph, np.zeros((count, 3)), seed=seed, probability=0.5, radius=1.0)
        self.lists = neighbours(count, edges)
        self.others = [self.lists.row(agent).index[0].tolist() for agent in range(count)]
        # The Kalman-consensus filter is the paper's with uniform weights, the others' papers leave them open.
        weights = uniform_weights(self.lists, EPSILON) if kind == "kcf" else metropolis_weights(self.lists)
        self.matrix = weight_matrix(self.lists, weights)
        self.motion = NearlyConstantVelocity(DT, 0.5, space.axes)
        self.omega = float(count) if omega is None else omega
        size = self.motion.size
        root = self.random.normal(scale=0.3, size=(count, size, size))
        covariance = root @ np.swapaxes(root, 1, 2) + 0.2 * np.eye(size)
        covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
        state = self.random.normal(size=(count, size))
        if together:
            state, covariance = np.tile(state[0], (count, 1)), np.tile(covariance[0], (count, 1, 1))
        self.state, self.covariance = list(state), list(covariance)
        told = FilterSettings(self.motion, space, STD, XI, count, omega)
        made, self.sharing = make_filter(kind, told), sharing_of(kind, told)
        self.tracker = Tracker(made, Average(weights), space, Belief(state, covariance))

    def measure(self, dropout=0.2):
        self.position = self.random.normal(scale=6.0, size=(self.count, 3))
        self.ranges = np.linalg.norm(self.position - [1.0, 2.0, 0.7], axis=1) + STD * self.random.normal(
            size=self.count
        )
        self.ranges[self.random.random(self.count) < dropout] = np.nan
        index = self.lists.index
        heard = np.where(self.lists.present, self.ranges[index], np.nan)
        if not self.sharing.uses_neighbour_ranges:
            index, heard = index[:, :0], heard[:, :0]
        return Measurement(self.position, self.ranges, np.zeros(self.count), self.position[index], heard)

    def step(self, rounds):
        """One step of the tracker: the beliefs it ends with."""
        measured = self.measure()
        message = self.tracker.measure(measured)
        for _ in range(rounds):
            message = self.tracker.exchange(message[self.lists.index], None)
        self.tracker.conclude()
        return self.tracker.belief

    def prior(self, agent):
        transition = self.motion.transition
        covariance = transition @ self.covariance[agent] @ transition.T + self.motion.process_noise
        return transition @ self.state[agent], covariance

    def row(self, agent, state):
        """Predicted range and gradient of one agent's range at a state."""
        place = state[:3] if self.space.height is None else np.append(state[:2], self.space.height)
        offset = place - self.position[agent]
        distance = np.linalg.norm(offset)
        row = np.zeros(len(state))
        row[: self.space.axes] = (offset / distance)[: self.space.axes]
        return distance, row

    def contribution(self, agent, state, covariance=None):
        """u and U of one agent's range, linearised at a state; saturated where a covariance is given."""
        if np.isnan(self.ranges[agent]):
            return np.zeros(len(state)), np.zeros((len(state), len(state)))
        distance, row = self.row(agent, state)
        innovation, weight = self.ranges[agent] - distance, 1.0
        if covariance is not None:
            weight = min(1.0, XI * np.sqrt(row @ covariance @ row + STD**2) / abs(innovation))
        return weight * row * (innovation + row @ state) / STD**2, weight * np.outer(row, row) / STD**2

    def plain_step(self, rounds):
        """The same step by the equations."""
        mixing = np.linalg.matrix_power(self.matrix, rounds)
        mixed = {"ci": self.plain_information, "hcmci": self.plain_information}
        results = mixed.get(self.kind, self.plain_neighbourhood)(mixing)
        self.state, self.covariance = [one for one, _ in results], [one for _, one in results]
        return np.array(self.state), np.array(self.covariance)

    def plain_information(self, mixing):
        priors, news = [], []
        for agent in range(self.count):
            state, covariance = self.prior(agent)
            information = np.linalg.inv(covariance)
            priors.append((information @ state, information))
            news.append(self.contribution(agent, state, covariance))
        omega = 1.0 if self.kind == "ci" else self.omega
        results = []
        for weights in mixing:
            vector = sum(w * (q + omega * u) for w, (q, _), (u, _) in zip(weights, priors, news, strict=True))
            matrix = sum(w * (p + omega * m) for w, (_, p), (_, m) in zip(weights, priors, news, strict=True))
            results.append((np.linalg.solve(matrix, vector), np.linalg.inv(matrix)))
        return results

    def plain_neighbourhood(self, mixing):
        priors = [self.prior(agent) for agent in range(self.count)]
        local = []
        for agent, (state, covariance) in enumerate(priors):
            parts = [self.contribution(other, state) for other in [agent, *self.others[agent]]]
            vector, matrix = sum(u for u, _ in parts), sum(m for _, m in parts)
            updated = np.linalg.inv(np.linalg.inv(covariance) + matrix)
            local.append((state + updated @ (vector - matrix @ state), updated))
        if self.kind == "diffusion":
            return [
                (sum(w * psi for w, (psi, _) in zip(weights, local, strict=True)), local[agent][1])
                for agent, weights in enumerate(mixing)
            ]
        results = []
        for agent, (state, covariance) in enumerate(priors):
            gamma = EPSILON / (1.0 + np.linalg.norm(covariance, "fro"))
            pull = sum((priors[other][0] - state for other in self.others[agent]), np.zeros(len(state)))
            updated, remaining = local[agent]
            results.append((updated + gamma * covariance @ pull, remaining))
        return results


@settings(deadline=None, derandomize=True, max_examples=25)
@given(SEEDS, SPACES, st.sampled_from(["ci", "hcmci", "kcf", "diffusion"]), st.sampled_from([0.5, 3.0, None]))
def test_several_steps_are_the_papers_equations(seed, space, kind, omega):
    network = Network(kind, space, seed, omega=omega)
    rounds = 1 if kind == "kcf" else 3
    for _ in range(3):
        belief = network.step(rounds)
        state, covariance = network.plain_step(rounds)
        np.testing.assert_allclose(belief.state, state, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(belief.known_covariance, covariance, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("kind", ["icf", "hcmci", "kcf", "diffusion"])
@pytest.mark.parametrize("space", [Space(), Space(0.7)])
def test_agents_that_all_hear_each_other_and_begin_alike_are_the_centralised_kalman_filter(kind, space):
    network = Network(kind, space, 4, graph="complete", together=True)
    if kind == "hcmci":
        network.tracker.filter = make_filter(kind, FilterSettings(network.motion, space, STD, 1e300, network.count))
    for _ in range(4):
        state, covariance = network.prior(0)
        belief = network.step(1)
        heard = np.flatnonzero(np.isfinite(network.ranges))
        found = [network.row(agent, state) for agent in heard]
        rows = np.array([row for _, row in found])
        gain = covariance @ rows.T @ np.linalg.inv(rows @ covariance @ rows.T + STD**2 * np.eye(len(heard)))
        expected = state + gain @ (network.ranges[heard] - np.array([distance for distance, _ in found]))
        remaining = covariance - gain @ rows @ covariance
        np.testing.assert_allclose(belief.state, np.tile(expected, (network.count, 1)), atol=1e-8)
        np.testing.assert_allclose(belief.known_covariance, np.tile(remaining, (network.count, 1, 1)), atol=1e-8)
        network.state, network.covariance = [expected] * network.count, [remaining] * network.count


@pytest.mark.parametrize("kind", ["icf", "hcmci", "ci", "local", "kcf", "diffusion"])
def test_the_nis_is_the_squared_innovation_over_its_predicted_variance(kind):
    network = Network(kind, Space(), 11)
    network.tracker.measure(network.measure())
    estimate = network.tracker.conclude()
    for agent in range(network.count):
        state, covariance = network.prior(agent)
        distance, row = network.row(agent, state)
        variance = row @ covariance @ row + STD**2
        np.testing.assert_allclose(estimate.diagnostics.nis[agent], (network.ranges[agent] - distance) ** 2 / variance)
        assert estimate.diagnostics.nis_degrees[agent] == np.isfinite(network.ranges[agent])
    assert 0 < estimate.diagnostics.nis_degrees.sum() < network.count


@pytest.mark.parametrize(("same", "omega"), [("sicf", None), ("ci", 1.0)])
def test_hcmci_is_the_information_weighted_filter_or_covariance_intersection_by_its_weight(same, omega):
    hybrid, other = Network("hcmci", Space(), 5, omega=omega), Network(same, Space(), 5)
    for _ in range(5):
        first, second = hybrid.step(2), other.step(2)
        np.testing.assert_allclose(first.state, second.state, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(first.covariance, second.covariance, rtol=1e-7, atol=1e-9)


def test_covariance_intersection_of_equal_priors_counts_them_once():
    # Without any measurement the agents know no more after averaging than each did before.
    network = Network("ci", Space(), 6, together=True)
    _, covariance = network.prior(0)
    network.tracker.measure(network.measure(dropout=1.1))
    network.tracker.conclude()
    np.testing.assert_allclose(network.tracker.belief.known_covariance, np.tile(covariance, (5, 1, 1)), rtol=1e-9)


@pytest.mark.parametrize(("kind", "size"), [("ci", 27), ("hcmci", 54), ("kcf", 6), ("diffusion", 6), ("sicf", 27)])
def test_payloads_are_as_long_as_they_say(kind, size):
    network = Network(kind, Space(), 7)
    assert network.sharing.payload_size == size
    assert network.tracker.measure(network.measure()).shape == (5, size)


@pytest.mark.parametrize("kind", ["kcf", "diffusion"])
def test_an_agent_whose_neighbours_are_not_heard_updates_with_its_own_range(kind):
    network = Network(kind, Space(), 8)
    measured = network.measure(dropout=0.0)
    silent = Measurement(
        measured.position,
        measured.range,
        measured.age,
        np.zeros_like(measured.neighbour_position),
        np.full_like(measured.neighbour_range, np.nan),
    )
    network.tracker.measure(silent)
    network.tracker.conclude()
    for agent in range(network.count):
        state, covariance = network.prior(agent)
        vector, matrix = network.contribution(agent, state)
        remaining = np.linalg.inv(np.linalg.inv(covariance) + matrix)
        expected = state + remaining @ (vector - matrix @ state)
        np.testing.assert_allclose(network.tracker.belief.state[agent], expected, atol=1e-8)
        np.testing.assert_allclose(network.tracker.belief.known_covariance[agent], remaining, atol=1e-8)
