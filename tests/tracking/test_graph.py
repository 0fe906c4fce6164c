"""Graphs have exactly the edges that their kind names, and neighbour lists follow from them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.errors import UserError
from zenoh_cbef.streams import stream, uniform
from zenoh_cbef.tracking.graph import KINDS, canonical_edges, components, make_edges, neighbours, stack


def edges_of(kind, count, *, seed=1, probability=0.5, radius=1.0, positions=None):
    places = np.zeros((count, 3)) if positions is None else np.array(positions, dtype=float)
    return make_edges(kind, places, seed=seed, probability=probability, radius=radius)


EXACT = {
    ("ring", 1): [],
    ("ring", 2): [[0, 1]],
    ("ring", 3): [[0, 1], [0, 2], [1, 2]],
    ("ring", 5): [[0, 1], [0, 4], [1, 2], [2, 3], [3, 4]],
    ("path", 1): [],
    ("path", 2): [[0, 1]],
    ("path", 4): [[0, 1], [1, 2], [2, 3]],
    ("star", 1): [],
    ("star", 2): [[0, 1]],
    ("star", 4): [[0, 1], [0, 2], [0, 3]],
    ("complete", 1): [],
    ("complete", 2): [[0, 1]],
    ("complete", 4): [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]],
    ("grid", 1): [],
    ("grid", 2): [[0, 1]],
    ("grid", 3): [[0, 1], [0, 2]],
    ("grid", 4): [[0, 1], [0, 2], [1, 3], [2, 3]],
    ("grid", 6): [[0, 1], [0, 3], [1, 2], [1, 4], [2, 5], [3, 4], [4, 5]],
    ("grid", 7): [[0, 1], [0, 3], [1, 2], [1, 4], [2, 5], [3, 4], [3, 6], [4, 5]],
}


@pytest.mark.parametrize(("kind", "count"), EXACT)
def test_regular_graphs_have_exactly_their_edges(kind, count):
    assert edges_of(kind, count).tolist() == EXACT[kind, count]


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "geometric"])
@pytest.mark.parametrize("count", [*range(1, 12), 16, 17, 30])
def test_graphs_are_connected_and_canonical_for_any_number_of_agents(kind, count):
    edges = edges_of(kind, count)
    assert edges.shape == (len(edges), 2)
    assert edges.dtype == np.int64
    assert (edges[:, 0] < edges[:, 1]).all()
    assert edges.tolist() == sorted(map(list, {tuple(edge) for edge in edges.tolist()}))
    assert components(count, edges) == [list(range(count))]


def test_every_known_kind_makes_edges():
    for kind in KINDS:
        assert edges_of(kind, 4, radius=1.0).shape[1] == 2


def test_geometric_joins_agents_up_to_the_radius_and_no_farther():
    places = [[0, 0, 0], [3, 4, 0], [3, 4, 5.001], [-5, 0, 0]]
    assert edges_of("geometric", 4, radius=5.0, positions=places).tolist() == [[0, 1], [0, 3]]
    assert edges_of("geometric", 4, radius=4.999, positions=places).tolist() == []


def test_erdos_renyi_is_a_function_of_its_seed():
    assert edges_of("erdos-renyi", 10, seed=3).tolist() == edges_of("erdos-renyi", 10, seed=3).tolist()
    assert len({edges_of("erdos-renyi", 10, seed=seed).tobytes() for seed in range(20)}) > 15
    assert edges_of("erdos-renyi", 6, seed=2**64 - 1).size > 0


def test_erdos_renyi_has_about_the_share_of_edges_it_is_asked_for():
    pairs = 30 * 29 / 2
    counts = [len(edges_of("erdos-renyi", 30, seed=seed, probability=0.4)) for seed in range(40)]
    assert abs(np.mean(counts) / pairs - 0.4) < 6 * np.sqrt(0.24 / (40 * pairs))


def test_erdos_renyi_that_cannot_be_connected_names_the_remedy():
    with pytest.raises(UserError, match=r"network\.probability = 1e-09 .*raise it"):
        edges_of("erdos-renyi", 20, probability=1e-9)


def test_a_graph_that_will_hardly_ever_be_connected_is_not_drawn(monkeypatch):
    monkeypatch.setattr("zenoh_cbef.tracking.graph.uniform", None)
    with pytest.raises(UserError, match=r"hardly ever joins 1000 agents .* ln\(n\)/n = 0\.0069 or above"):
        edges_of("erdos-renyi", 1000, probability=1e-3)


def test_a_graph_of_more_agents_than_are_drawn_at_once_is_the_whole_draw():
    first, second = np.triu_indices(150, 1)
    drawn = uniform(stream(5, "graph", first, second), 0) < 0.2
    assert (
        edges_of("erdos-renyi", 150, seed=5, probability=0.2).tolist() == np.stack([first, second], 1)[drawn].tolist()
    )


def test_canonical_edges_are_sorted_once_each_and_lower_end_first():
    assert canonical_edges([(3, 1), (0, 2), (1, 3), (2, 0)]).tolist() == [[0, 2], [1, 3]]
    assert canonical_edges([]).shape == (0, 2)


def test_components_are_listed_by_their_least_member():
    edges = np.array([[4, 5], [1, 3], [0, 5]])
    assert components(7, edges) == [[0, 4, 5], [1, 3], [2], [6]]
    assert components(1, np.empty((0, 2), dtype=np.int64)) == [[0]]


@st.composite
def graphs(draw):
    count = draw(st.integers(1, 9))
    pairs = [(first, second) for first in range(count) for second in range(first + 1, count)]
    chosen = draw(st.lists(st.sampled_from(pairs), unique=True)) if pairs else []
    return count, canonical_edges(chosen)


@settings(deadline=None)
@given(graphs())
def test_components_are_what_the_powers_of_the_adjacency_reach(graph):
    count, edges = graph
    adjacency = np.eye(count, dtype=int)
    adjacency[edges[:, 0], edges[:, 1]] = adjacency[edges[:, 1], edges[:, 0]] = 1
    reach = np.linalg.matrix_power(adjacency, count) > 0
    expected = {tuple(np.flatnonzero(row).tolist()) for row in reach}
    assert {tuple(part) for part in components(count, edges)} == expected


@settings(deadline=None)
@given(graphs())
def test_neighbour_lists_are_ascending_and_padded_with_the_agent_itself(graph):
    count, edges = graph
    lists = neighbours(count, edges)
    for agent in range(count):
        expected = sorted(sum(edge) - agent for edge in edges.tolist() if agent in edge)
        present = lists.present[agent]
        assert lists.index[agent][present].tolist() == expected
        assert (lists.index[agent][~present] == agent).all()
        assert lists.degree[agent] == len(expected)
        row = lists.row(agent)
        assert row.index.tolist() == [expected]
        assert row.present.all()
        assert row.present.shape == row.index.shape


@settings(deadline=None)
@given(st.lists(graphs(), min_size=1, max_size=4))
def test_a_stack_holds_every_graph_shifted_by_the_rows_before_it(several):
    blocks = [neighbours(*graph) for graph in several]
    stacked = stack(blocks)
    start = 0
    for (count, _), block in zip(several, blocks, strict=True):
        for agent in range(count):
            row = start + agent
            present = stacked.present[row]
            expected = (block.index[agent][block.present[agent]] + start).tolist()
            assert stacked.index[row][present].tolist() == expected
            assert (stacked.index[row][~present] == row).all()
        start += count
    assert len(stacked.index) == start


@pytest.mark.parametrize("count", range(1, 32))
def test_a_grid_links_agents_side_by_side_in_rows_of_a_near_square(count):
    columns = int(np.ceil(np.sqrt(count)))
    places = np.array([divmod(agent, columns) for agent in range(count)])
    apart = np.abs(places[:, None] - places[None]).sum(axis=2)
    expected = [[a, b] for a in range(count) for b in range(a + 1, count) if apart[a, b] == 1]
    assert make_edges("grid", np.zeros((count, 3)), seed=1, probability=0.0, radius=0.0).tolist() == expected
