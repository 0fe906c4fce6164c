"""A scenario's tracker begins where the scenario says, with what it says."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario import network, paths
from zenoh_cbef.scenario.build import (
    agent_tracker,
    batch_tracker,
    consensus_of,
    filter_of,
    message_size,
    motion_of,
    power_of,
    range_std_of,
    rounds_of,
    scheme_of,
    space_of,
)
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.start import initial_belief, initial_states
from zenoh_cbef.tracking import graph


def scenario(**keys):
    return parse({"agents": {"count": 5}, **keys}, "test")


def test_initial_estimates_are_spread_around_the_targets_start():
    one = scenario(
        agents={"count": 1000},
        target={"position": [10, 20, 30], "velocity": [1, 2, 3]},
        filter={"initial_position_std": 2.0, "initial_velocity_std": 0.5},
    )
    states = initial_states(one)
    std = np.repeat([2.0, 0.5], 3)
    assert (np.abs(states.mean(axis=0) - [10, 20, 30, 1, 2, 3]) < 6 * std / np.sqrt(1000)).all()
    assert (np.abs(states.std(axis=0) / std - 1.0) < 6 / np.sqrt(2000)).all()
    np.testing.assert_allclose(initial_belief(one).covariance, np.tile(np.diag(std**2), (1000, 1, 1)))


def test_given_initial_states_are_taken_as_they_are():
    one = scenario(filter={"initial_position": [1, 2, 3], "initial_velocity": [[n, 0, 0] for n in range(5)]})
    states = initial_states(one)
    assert states[:, :3].tolist() == [[1, 2, 3]] * 5
    assert states[:, 3].tolist() == [0, 1, 2, 3, 4]


def test_a_plane_holds_its_height():
    one = scenario(filter={"planar_height": 1.5})
    assert (initial_states(one)[:, [2, 5]] == [1.5, 0.0]).all()
    assert space_of(one).axes == 2
    assert initial_belief(one).state.shape == (5, 4)


def test_what_the_filter_is_not_told_it_takes_from_target_and_sensor():
    keys = {"target": {"acceleration_std": 0.7}, "sensor": {"range_std": 0.3}}
    told = scenario(**keys, filter={"acceleration_std": 0.2, "range_std": 0.9})
    assert motion_of(scenario(**keys)).acceleration_std == 0.7
    assert range_std_of(scenario(**keys)) == 0.3
    assert motion_of(told).acceleration_std == 0.2
    assert range_std_of(told) == 0.9


def test_a_filter_that_keeps_to_itself_has_no_rounds():
    assert rounds_of(scenario(filter={"kind": "local"})) == 0
    assert rounds_of(scenario(consensus={"rounds": 7})) == 7


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
    picked, reason = scheme_of(scenario(**keys))
    assert picked == chosen
    assert why in reason
    assert reason.endswith(".")


def test_running_sums_send_one_number_more():
    for kind, size in (("sicf", 27), ("hcmci", 54), ("cbef", 6)):
        keys = {"filter": {"kind": kind}}
        assert message_size(scenario(**keys)) == size
        assert message_size(scenario(**keys, consensus={"scheme": "running-sums"})) == size + 1


def test_a_network_of_one_agent_has_nobody_to_talk_to():
    one = scenario(agents={"count": 1})
    tracker, others = agent_tracker(one, 0)
    assert others == []
    assert tracker.belief.state.shape == (1, 6)
    assert network.edges(one).shape == (0, 2)


@pytest.mark.parametrize("acceleration", ["none", "chebyshev"])
def test_an_agents_neighbours_and_weights_are_its_row_of_the_batch(acceleration):
    one = scenario(consensus={"acceleration": acceleration}, seed=4)
    batch, lists = batch_tracker([one])
    for agent in range(5):
        tracker, others = agent_tracker(one, agent)
        assert others == lists.row(agent).index[0].tolist()
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


@pytest.mark.parametrize(
    ("keys", "power"),
    [
        ({}, 1),
        ({"sensor": {"outlier_probability": 0.1}}, 2),
        ({"sensor": {"outlier_probability": 0.1}, "filter": {"saturation": "bounded"}}, 1),
        ({"filter": {"saturation": "redescending"}}, 2),
    ],
)
def test_saturation_redescends_where_outliers_are_expected(keys, power):
    assert power_of(scenario(**keys)) == power
    assert filter_of(scenario(**keys)).power == power


def test_eigenvalue_bounds_are_the_graphs_unless_given():
    chebyshev = {"acceleration": "chebyshev", "rounds": 5}
    ring = {"consensus": chebyshev, "network": {"graph": "ring"}}
    values = []
    for keys in ({}, {"bounds": [-0.4, 0.9]}):
        one = scenario(**{**ring, "consensus": {**chebyshev, **keys}})
        lists = graph.neighbours(one.count, network.edges(one))
        values.append(consensus_of(one, lists)[1][0].tolist())
    # Five agents on a ring with weights of a third.
    ring_values = [1 / 3 + 2 / 3 * np.cos(2 * np.pi * k / 5) for k in (2, 1)]
    np.testing.assert_allclose(values, [ring_values, [-0.4, 0.9]])


def test_without_rounds_everybody_is_a_network_of_one():
    assert filter_of(scenario(consensus={"rounds": 0})).network_size == 1
    assert rounds_of(scenario(consensus={"rounds": 0})) == 0
