"""Who talks to whom: placement, edges and consensus weights of a scenario."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef import streams
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.tracking import graph, weights

Floats = NDArray[np.float64]


def placement(scenario: Scenario) -> Floats:
    """The agents' positions at step 0, (n, 3), m."""
    agents, count = scenario.agents, scenario.count
    if agents.motion == "waypoints":
        return np.array([points[0] for points in agents.waypoints])
    if agents.positions is not None:
        return np.array(agents.positions[:count])
    low, high = np.broadcast_to(agents.low, 3), np.broadcast_to(agents.high, 3)
    key = streams.stream(scenario.seed, "placement", np.arange(count))[:, None]
    return np.asarray(low + (high - low) * streams.uniform(key, 0, np.arange(3)))


def edges(scenario: Scenario) -> graph.Edges:
    """The undirected communication graph, (m, 2)."""
    network = scenario.network
    if network.edges is not None:
        return graph.canonical_edges(list(network.edges))
    return graph.make_edges(
        network.graph,
        placement(scenario),
        seed=scenario.seed,
        probability=network.probability,
        radius=network.radius,
    )


def epsilon(scenario: Scenario, neighbours: graph.Neighbours) -> float:
    """The step of uniform weights."""
    chosen = scenario.consensus.epsilon
    return 1.0 / (float(neighbours.degree.max(initial=0)) + 1.0) if chosen is None else chosen


def consensus_weights(scenario: Scenario, neighbours: graph.Neighbours) -> Floats:
    """The weight of every neighbour, (n, m)."""
    if scenario.consensus.weights == "uniform":
        return weights.uniform_weights(neighbours, epsilon(scenario, neighbours))
    return weights.metropolis_weights(neighbours)
