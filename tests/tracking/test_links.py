"""A batch averages link by link what agents with neighbours of their own average neighbour by neighbour: equal bits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.consensus import Average, Consensus, RunningSums
from zenoh_cbef.tracking.graph import Neighbours, neighbours
from zenoh_cbef.tracking.links import Links


def drawn(seed: int, agents: int, share: float) -> Neighbours:
    """A graph in which some pairs are neighbours; agents may be alone."""
    first, second = np.triu_indices(agents, 1)
    joined = np.random.default_rng(seed).random(len(first)) < share
    return neighbours(agents, np.stack([first[joined], second[joined]], axis=1).astype(np.int64))


def rounds_of(stage: Consensus, graph: Neighbours, payload: Floats, came: list[Bools], *, linked: bool) -> list[Floats]:
    """What is sent round by round, and the result."""
    sent = [stage.start(payload)]
    for delivered in came:
        sent.append(stage.mix(sent[-1] if linked else sent[-1][graph.index], delivered))
    return [*sent, stage.result()]


@given(st.integers(0, 1000), st.integers(1, 9), st.sampled_from([0.0, 0.3, 0.7, 1.0]), st.sampled_from([0.0, 0.3, 1.0]))
def test_links_give_the_bits_that_neighbours_give(seed: int, agents: int, share: float, lost: float) -> None:
    graph, random = drawn(seed, agents, share), np.random.default_rng(seed + 1)
    payload, weights = random.normal(size=(agents, 3)), np.where(graph.present, random.random(graph.present.shape), 0.0)
    came = [graph.present & (random.random(graph.present.shape) >= lost) for _ in range(4)]
    links = Links(graph)
    pairs: list[tuple[Consensus, Consensus]] = [
        (Average(weights, links=links), Average(weights)),
        (RunningSums(graph.present, links=links), RunningSums(graph.present)),
    ]
    for one, other in pairs:
        found = rounds_of(one, graph, payload, came, linked=True)
        for mine, theirs in zip(found, rounds_of(other, graph, payload, came, linked=False), strict=True):
            np.testing.assert_array_equal(mine, theirs)


def test_links_hold_no_padding_and_know_where_they_come_from() -> None:
    star = Links(neighbours(4, np.array([[0, 1], [0, 2], [0, 3]])))
    assert star.order.tolist() == [0, 1, 2, 3]
    assert star.source.tolist() == [1, 0, 0, 0, 2, 3]
    assert star.blocks == [slice(0, 4), slice(4, 5), slice(5, 6)]
    assert star.summed(np.arange(6.0)[:, None]).ravel().tolist() == [9.0, 1.0, 2.0, 3.0]


@pytest.mark.parametrize("lost", [[], [2, 5]])
def test_links_that_missed_are_those_over_which_nothing_came(lost: list[int]) -> None:
    star = neighbours(4, np.array([[0, 1], [0, 2], [0, 3]]))
    links, delivered = Links(star), star.present.copy()
    delivered[0, 2], delivered[2, 0] = not lost, not lost
    assert links.missed(delivered).tolist() == lost
    assert not len(links.missed(None))
