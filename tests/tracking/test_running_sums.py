"""Running sums lose nothing for good: a lost share waits on its link, and the next packet brings it."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from zenoh_cbef.tracking.consensus import Average, RunningSums
from zenoh_cbef.tracking.graph import make_edges, neighbours
from zenoh_cbef.tracking.weights import metropolis_weights


def graph(kind="erdos-renyi", count=7, seed=2):
    return neighbours(count, make_edges(kind, np.zeros((count, 3)), seed=seed, probability=0.4, radius=1.0))


def run(consensus, lists, payload, delivered):
    message = consensus.start(payload)
    for flags in delivered:
        message = consensus.mix(message[lists.index], flags)
    return consensus.result()


def losses(lists, rounds, probability):
    random = np.random.default_rng(3)
    return (random.random((rounds, *lists.index.shape)) >= probability) & lists.present


class Parcels:
    """The same without running sums: every share travels as a parcel, and a link that fails keeps its parcels.

    This is the view of the paper's proof, with a virtual node on every link, in exact fractions.
    """

    def __init__(self, lists, payload):
        self.others = [lists.row(agent).index[0].tolist() for agent in range(len(payload))]
        self.mass = [[Fraction(value), Fraction(1)] for value in payload]
        self.waiting = {(a, b): [Fraction(0)] * 2 for a, others in enumerate(self.others) for b in others}

    def round(self, arrives):
        kept = []
        for agent, others in enumerate(self.others):
            share = [part / (len(others) + 1) for part in self.mass[agent]]
            kept.append(share)
            for other in others:
                self.waiting[agent, other] = [a + b for a, b in zip(self.waiting[agent, other], share, strict=True)]
        for (source, destination), parcel in self.waiting.items():
            if arrives(source, destination):
                kept[destination] = [a + b for a, b in zip(kept[destination], parcel, strict=True)]
                self.waiting[source, destination] = [Fraction(0)] * 2
        self.mass = kept

    @property
    def ratios(self):
        return [float(value / one) for value, one in self.mass]


@pytest.mark.parametrize("kind", ["ring", "path", "star", "complete", "erdos-renyi"])
@pytest.mark.parametrize("probability", [0.0, 0.3, 0.8, 1.0])
def test_running_sums_are_parcels_that_wait_on_their_links(kind, probability):
    lists = graph(kind)
    payload = np.random.default_rng(4).normal(size=(7, 1))
    delivered = losses(lists, 8, probability)
    parcels = Parcels(lists, payload[:, 0].tolist())
    for rounds in range(9):
        mixed = run(RunningSums(lists.present), lists, payload, delivered[:rounds])
        np.testing.assert_allclose(mixed[:, 0], parcels.ratios, rtol=0, atol=1e-13)
        if rounds < 8:
            flags = delivered[rounds]
            parcels.round(lambda a, b, flags=flags: flags[b, lists.index[b].tolist().index(a)])


@pytest.mark.parametrize("probability", [0.0, 0.3, 0.6, 0.9])
def test_the_average_is_reached_however_much_is_lost_and_plain_averaging_misses_it(probability):
    lists = graph()
    payload = np.random.default_rng(5).normal(size=(7, 4))
    delivered = losses(lists, 600, probability)
    mean = np.tile(payload.mean(axis=0), (7, 1))
    np.testing.assert_allclose(run(RunningSums(lists.present), lists, payload, delivered), mean, atol=1e-9)
    if probability:
        plain = run(Average(metropolis_weights(lists)), lists, payload, delivered)
        assert np.abs(plain - mean).max() > 1e-3


def test_the_next_packet_repairs_a_lost_one():
    lists = graph("path", 2)
    payload = np.array([[1.0], [3.0]])
    lost = lists.present.copy()
    lost[1, 0] = False
    consensus = RunningSums(lists.present)
    message = consensus.start(payload)
    np.testing.assert_array_equal(message, [[0.5, 0.5], [1.5, 0.5]])
    message = consensus.mix(message[lists.index], lost)
    # Agent 1 kept 1.5 of 3 and heard nothing; agent 0 has 0.5 of its own and 1.5 from agent 1.
    np.testing.assert_array_equal(consensus.result(), [[2.0], [3.0]])
    np.testing.assert_array_equal(message, [[1.5, 1.0], [2.25, 0.75]])
    consensus.mix(message[lists.index], None)
    # Agent 1 keeps 0.75 with weight 1/4, and gets all of 1.5 with weight 1.
    np.testing.assert_allclose(consensus.result(), [[(1.0 + 0.75) / (0.5 + 0.25)], [(0.75 + 1.5) / (0.25 + 1.0)]])


def test_what_comes_out_lies_between_the_payloads():
    lists = graph()
    payload = np.random.default_rng(6).normal(size=(7, 3))
    for rounds in range(6):
        mixed = run(RunningSums(lists.present), lists, payload, losses(lists, rounds, 0.7))
        assert (mixed <= payload.max(axis=0) + 1e-12).all()
        assert (mixed >= payload.min(axis=0) - 1e-12).all()


def test_an_agent_keeps_what_it_is_given_in_an_array_that_is_used_again():
    lists = graph("ring", 5)
    payload = np.random.default_rng(7).normal(size=(5, 2))
    shared, fresh = RunningSums(lists.present), RunningSums(lists.present)
    buffer = np.empty((5, 2, 3))
    first, second = shared.start(payload), fresh.start(payload)
    for flags in losses(lists, 6, 0.4):
        buffer[:] = first[lists.index]
        first, second = shared.mix(buffer, flags), fresh.mix(second[lists.index], flags)
        buffer[:] = np.nan
    assert shared.result().tobytes() == fresh.result().tobytes()
