"""Which agents exchange messages: edges and consensus weights of a scenario."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.faults import MessageFault, SensorDropout
from zenoh_cbef.scenario import bending, near_plane, trust
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.paths import agent_positions, placement
from zenoh_cbef.tracking import graph, weights
from zenoh_cbef.tracking.effective import effective_sizes

_HALF = 0.5
"""An average of a larger share of the agents passes for one of all."""

FEW = 12
"""How many agents may put a number each into every payload."""

MANY = 40
"""How many may do so where they may be cut off: little of a number is left at the other end of a line of them."""


def edges(scenario: Scenario) -> graph.Edges:
    """The undirected communication graph, (m, 2)."""
    network = scenario.network
    if network.edges is not None:
        return graph.canonical_edges(list(network.edges))
    if by_radio(scenario):
        ever = in_range(scenario).any(axis=2)
        return graph.canonical_edges([(int(first), int(second)) for first, second in np.argwhere(np.triu(ever, 1))])
    return graph.make_edges(
        network.graph,
        placement(scenario),
        seed=scenario.seed,
        probability=network.probability,
        radius=network.radius,
    )


def by_radio(scenario: Scenario) -> bool:
    """Whether agents hear each other only while they are in range."""
    return scenario.network.graph == "radio" and scenario.network.edges is None


def tells_members(scenario: Scenario) -> bool:
    """Whether agents tell each other who is there: if told to, or where they may be cut off and are not too many.

    They are cut off by faults, out of range, or because they isolate the agents between them.
    """
    chosen = scenario.filter.membership
    if chosen != "auto":
        return chosen
    isolates = scenario.filter.defaults > 11 and trust.isolates(scenario)
    many = scenario.filter.defaults > 19 and scenario.count <= MANY and scenario.consensus.precision == "float64"
    few = calls_roll(scenario) or (many and not scenario.consensus.trigger)
    return (parts(scenario) or isolates) and few and scenario.filter.defaults > 10


def calls_roll(scenario: Scenario) -> bool:
    """Whether each agent may have a number in every payload: there are few, and none keeps silent about a change."""
    return scenario.count <= FEW and not scenario.consensus.trigger


def parts(scenario: Scenario) -> bool:
    """Whether faults, or the way between agents, may part the network; by the nineteenth rules loss never does."""
    faults = [fault for fault in scenario.fault if isinstance(fault, MessageFault)]
    return any(one.loses_all if scenario.filter.defaults > 19 else one.cuts for one in faults) or by_radio(scenario)


def counts_hearers(scenario: Scenario) -> bool:
    """Whether agents count how many hear the target, as receivers may be out of its reach, or fall silent.

    By the fourteenth rules only few of them, that do not keep silent.
    """
    silent = scenario.sensor.reach is not None or any(isinstance(fault, SensorDropout) for fault in scenario.fault)
    asked = scenario.filter.status and scenario.filter.defaults > 13 and scenario.consensus.rounds > 0
    able = calls_roll(scenario) or scenario.filter.defaults > 14
    return silent and asked and able and not trust.real(scenario)


def may_be_in_a_plane(scenario: Scenario, axes: int, range_std: float, *, told: bool, drawn_flat: bool) -> bool:
    """Whether all agents, or a group that is cut off from others, may be as few as make a plane, or a line of two axes.

    Or, by the fifteenth rules, all are in one. By today's a seed may place them so (drawn_flat), or those that hear the
    target may be so few, but if they tell each other their ranges (told), they keep both sides as hypotheses.

    For agents that say what their estimates are, and do not presume to be on the side that they are on. Those with real
    ranges do, but where all of them leave it open.
    """
    asked = scenario.filter.status and scenario.consensus.rounds > 0
    if trust.presumes(scenario):
        return asked and near_plane.anchors_leave_sides(scenario, range_std, axes)
    may = scenario.count == axes or tells_members(scenario)
    may |= scenario.filter.defaults > 14 and (drawn_flat or bending.mirrored(scenario, range_std, axes))
    may |= scenario.filter.defaults > 15 and counts_hearers(scenario) and not told
    return asked and scenario.count >= axes and may


def in_range(scenario: Scenario) -> Bools:
    """Which agents are within `network.radius` of each other in steps 1 to K, (n, n, K)."""
    positions = agent_positions(scenario)
    return np.stack([_near(positions, own, scenario.network.radius) for own in positions])


def in_range_of(scenario: Scenario, agent: int) -> Bools:
    """As in_range, for one agent, (n, K)."""
    positions = agent_positions(scenario)
    return _near(positions, positions[agent], scenario.network.radius)


def _near(positions: Floats, own: Floats, radius: float) -> Bools:
    """Which of the positions (n, K, 3) are within a radius (m) of our own (K, 3), (n, K)."""
    return np.asarray(np.linalg.norm(positions - own, axis=2) <= radius)


def epsilon(scenario: Scenario, neighbours: graph.Neighbours) -> float:
    """The step of uniform weights."""
    chosen = scenario.consensus.epsilon
    return 1.0 / (float(neighbours.degree.max(initial=0)) + 1.0) if chosen is None else chosen


def consensus_weights(scenario: Scenario, neighbours: graph.Neighbours) -> Floats:
    """The weight of every neighbour, (n, m)."""
    if scenario.consensus.weights == "uniform":
        return weights.uniform_weights(neighbours, epsilon(scenario, neighbours))
    return weights.metropolis_weights(neighbours)


def overcounted(scenario: Scenario, neighbours: graph.Neighbours, chosen: Floats) -> Floats:
    """How often n times an agent's average counts what the network has once, (n,); 1 where that is no matter.

    Where averages are of fewer than half of the agents, each counts its own neighbourhood several times (see
    `effective_sizes`). A few agents are then too sure by so little that counting less costs more. chosen: the weight
    of every neighbour, (n, m).
    """
    stage, count = scenario.consensus, scenario.count
    if scenario.filter.defaults < 13 or count <= FEW or not stage.rounds or stage.acceleration != "none":
        return np.ones(count)
    sizes = effective_sizes(neighbours, chosen, stage.rounds)
    return np.asarray(count / sizes) if float(sizes.mean()) < _HALF * count else np.ones(count)


def bounds(scenario: Scenario, neighbours: graph.Neighbours) -> tuple[float, float]:
    """Least and largest eigenvalue of W other than 1; zeros where averaging is not accelerated."""
    stage = scenario.consensus
    if stage.acceleration != "chebyshev":
        return 0.0, 0.0
    chosen = consensus_weights(scenario, neighbours)
    return stage.bounds or weights.spectrum_bounds(weights.weight_matrix(neighbours, chosen))
