"""A scenario's tracker begins where the scenario says, with what it says."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario import network, paths
from zenoh_cbef.scenario.build import (
    agent_tracker,
    batch_tracker,
)
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking import graph
from zenoh_cbef.tracking.consensus import Average, Chebyshev


def scenario(**keys):
    return parse({"agents": {"count": 5}, **keys}, "test")


def test_initial_estimates_are_spread_around_the_targets_start():
    one = scenario(
        agents={"count": 1000},
        target={"position": [10, 20, 30], "velocity": [1, 2, 3]},
        filter={"initial_position_std": 2.0, "initial_velocity_std": 0.5},
    )
    states = Plan(one).initial_states
    std = np.repeat([2.0, 0.5], 3)
    assert (np.abs(states.mean(axis=0) - [10, 20, 30, 1, 2, 3]) < 6 * std / np.sqrt(1000)).all()
    assert (np.abs(states.std(axis=0) / std - 1.0) < 6 / np.sqrt(2000)).all()
    np.testing.assert_allclose(Plan(one).initial_belief.known_covariance, np.tile(np.diag(std**2), (1000, 1, 1)))


def test_given_initial_states_are_taken_as_they_are():
    one = scenario(filter={"initial_position": [1, 2, 3], "initial_velocity": [[n, 0, 0] for n in range(5)]})
    states = Plan(one).initial_states
    assert states[:, :3].tolist() == [[1, 2, 3]] * 5
    assert states[:, 3].tolist() == [0, 1, 2, 3, 4]


def test_a_plane_holds_its_height():
    one = scenario(filter={"planar_height": 1.5})
    assert (Plan(one).initial_states[:, [2, 5]] == [1.5, 0.0]).all()
    assert Plan(one).space.axes == 2
    assert Plan(one).initial_belief.state.shape == (5, 4)


def test_what_the_filter_is_not_told_it_takes_from_target_and_sensor():
    keys = {"target": {"acceleration_std": 0.7}, "sensor": {"range_std": 0.3}}
    told = scenario(**keys, filter={"acceleration_std": 0.2, "range_std": 0.9})
    assert Plan(scenario(**keys)).motion.acceleration_std == 0.7
    assert Plan(scenario(**keys)).range_std == 0.3
    assert Plan(told).motion.acceleration_std == 0.2
    assert Plan(told).range_std == 0.9


def test_a_filter_that_keeps_to_itself_has_no_rounds():
    assert Plan(scenario(filter={"kind": "local"})).rounds == 0
    assert Plan(scenario(consensus={"rounds": 7})).rounds == 7


LOSS = {"kind": "loss", "probability": 0.1}


@pytest.mark.parametrize(
    ("keys", "chosen", "why"),
    [
        ({}, "average", "No link has a fault"),
        ({"fault": [LOSS]}, "running-sums", "repairs"),
        ({"fault": [LOSS], "filter": {"kind": "ci"}}, "running-sums", "repairs"),
        ({"fault": [LOSS], "filter": {"kind": "kcf"}}, "average", "kcf does not average information"),
        ({"fault": [LOSS], "filter": {"kind": "cbef"}}, "average", "cbef does not average information"),
        ({"fault": [LOSS], "consensus": {"acceleration": "chebyshev"}}, "average", "cannot be accelerated"),
        ({"fault": [LOSS], "consensus": {"scheme": "average"}}, "average", "was given"),
        ({"consensus": {"scheme": "running-sums"}}, "running-sums", "was given"),
    ],
)
def test_auto_picks_running_sums_where_links_fail_and_says_why(keys, chosen, why):
    picked, reason = Plan(scenario(**keys)).scheme
    assert picked == chosen
    assert why in reason
    assert reason.endswith(".")


def test_running_sums_send_one_number_more():
    for kind, size in (("sicf", 31), ("hcmci", 56), ("cbef", 6)):
        keys = {"filter": {"kind": kind}}
        assert Plan(scenario(**keys)).message_size == size
        assert Plan(scenario(**keys, consensus={"scheme": "running-sums"})).message_size == size + 1


def test_a_network_of_one_agent_has_no_neighbour():
    one = scenario(agents={"count": 1})
    tracker, others = agent_tracker(Plan(one), 0)
    assert others == []
    assert tracker.belief.state.shape == (1, 6)
    assert network.edges(one).shape == (0, 2)


@pytest.mark.parametrize("acceleration", ["none", "chebyshev"])
def test_an_agents_neighbours_and_weights_are_its_row_of_the_batch(acceleration):
    one = scenario(consensus={"acceleration": acceleration}, seed=4)
    batch, lists = batch_tracker([Plan(one)])
    for agent in range(5):
        tracker, others = agent_tracker(Plan(one), agent)
        assert others == lists.row(agent).index[0].tolist()
        assert isinstance(batch.consensus, Average | Chebyshev)
        assert isinstance(tracker.consensus, Average | Chebyshev)
        weights = batch.consensus.weights[agent][lists.present[agent]]
        assert tracker.consensus.weights.tolist() == [weights.tolist()]
        assert tracker.belief.state.tobytes() == batch.belief.state[agent].tobytes()


def test_explicit_edges_and_positions_override_graph_and_placement():
    places = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    one = parse(
        {
            "agents": {"positions": places, "count": 2},
            "network": {"graph": "star", "edges": [[1, 0], [0, 1]]},
        },
        "test",
    )
    assert paths.placement(one).tolist() == places[:2]
    assert network.edges(one).tolist() == [[0, 1]]


def test_uniform_weights_use_epsilon_or_the_largest_degree():
    keys = {"agents": {"count": 4}, "network": {"graph": "star"}}
    lists = graph.neighbours(4, np.array([[0, 1], [0, 2], [0, 3]]))
    assert network.epsilon(parse(keys, "test"), lists) == 0.25
    assert network.epsilon(parse({**keys, "consensus": {"epsilon": 0.1}}, "test"), lists) == 0.1


def test_eigenvalue_bounds_are_the_graphs_unless_given():
    chebyshev = {"acceleration": "chebyshev", "rounds": 5}
    ring = {"consensus": chebyshev, "network": {"graph": "ring"}}
    values = []
    for keys in ({}, {"bounds": [-0.4, 0.9]}):
        one = scenario(**{**ring, "consensus": {**chebyshev, **keys}})
        values.append(Plan(one).bounds[0].tolist())
    # Five agents on a ring with weights of a third.
    ring_values = [1 / 3 + 2 / 3 * np.cos(2 * np.pi * k / 5) for k in (2, 1)]
    np.testing.assert_allclose(values, [ring_values, [-0.4, 0.9]])


def test_without_rounds_every_agent_is_a_network_of_one():
    plan = Plan(scenario(consensus={"rounds": 0}))
    assert plan.settings.network_size == 1
    assert plan.rounds == 0
