"""Trimmed averaging, against plain loops over lists and against what the paper promises."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.tracking.filters.information_form import pack
from zenoh_cbef.tracking.graph import make_edges, neighbours
from zenoh_cbef.tracking.payloads import InformationPayloads, StatePayloads
from zenoh_cbef.tracking.trimmed import TrimmedComponents, TrimmedMessages
from zenoh_cbef.tracking.weights import metropolis_weights


def graph(count, probability=0.6, seed=4, kind="erdos-renyi"):
    return neighbours(count, make_edges(kind, np.zeros((count, 3)), seed=seed, probability=probability, radius=1.0))


def component_by_hand(own, heard, trim):
    """One agent, one component. heard: (value, weight) of each neighbour; LeBlanc et al. 2013, section III."""
    larger = sorted((pair for pair in heard if pair[0] > own), key=lambda pair: -pair[0])
    smaller = sorted((pair for pair in heard if pair[0] < own), key=lambda pair: pair[0])
    used = larger[trim:] + smaller[trim:] + [pair for pair in heard if pair[0] == own]
    return (1.0 - sum(weight for _, weight in used)) * own + sum(value * weight for value, weight in used)


@pytest.mark.parametrize("trim", [1, 2, 5])
@pytest.mark.parametrize("lost", [False, True])
def test_components_are_trimmed_as_in_the_paper(trim, lost):
    random = np.random.default_rng(trim)
    lists, values = graph(8), random.normal(size=(8, 5)).round(1)  # rounded: equal values occur
    weights = metropolis_weights(lists)
    delivered = lists.present & (random.random(lists.present.shape) > 0.3) if lost else None
    stage = TrimmedComponents(weights, trim)
    message = stage.start(values)
    for _ in range(3):
        expected = np.empty_like(values)
        for agent, component in np.ndindex(*values.shape):
            there = lists.present[agent] if delivered is None else delivered[agent]
            heard = [
                (message[lists.index[agent, place], component], weights[agent, place])
                for place in np.flatnonzero(there)
            ]
            expected[agent, component] = component_by_hand(message[agent, component], heard, trim)
        message = stage.mix(message[lists.index], delivered)
        np.testing.assert_allclose(message, expected, atol=1e-12)
    assert stage.result() is message


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 2))
def test_whatever_f_liars_send_honest_components_stay_within_the_honest_range(seed, trim):
    random = np.random.default_rng(seed)
    lists = graph(9, kind="complete")
    values = random.normal(size=(9, 4))
    honest = values[trim:]  # the first F agents lie
    stage = TrimmedComponents(metropolis_weights(lists), trim)
    message = stage.start(values)
    for _ in range(6):
        sent = message.copy()
        sent[:trim] = random.normal(scale=10.0 ** random.integers(-2, 6), size=(trim, 4))
        message = stage.mix(sent[lists.index], None)
    assert (message[trim:] >= honest.min(axis=0) - 1e-12).all()
    assert (message[trim:] <= honest.max(axis=0) + 1e-12).all()
    apart = np.ptp(message[trim:], axis=0)
    assert (apart <= np.ptp(honest, axis=0) + 1e-12).all()


def information(random, count, size=6):
    """Payloads, states and matrices of `count` agents."""
    roots = random.normal(size=(count, size, size))
    matrices = roots @ np.swapaxes(roots, 1, 2) + np.eye(size)
    states = random.normal(size=(count, size))
    return pack((matrices @ states[:, :, None])[:, :, 0], matrices), states, matrices


@pytest.mark.parametrize("size", [4, 6])
def test_the_distance_of_messages_is_that_of_what_they_say(size):
    random = np.random.default_rng(size)
    payload, states, matrices = information(random, 5, size)
    reader = InformationPayloads(size // 2, size)
    found = reader.distance(payload, np.broadcast_to(payload, (5, 5, payload.shape[1])))
    for i, j in np.ndindex(5, 5):
        root = np.linalg.cholesky(matrices[i])
        # In coordinates in which the own matrix is the identity, and with the own state as the origin:
        other = np.linalg.solve(root, np.linalg.solve(root, matrices[j]).T)
        added = other @ root.T @ (states[j] - states[i])
        expected = added @ added + ((np.linalg.eigvalsh(other) - 1.0) ** 2).sum()
        assert found[i, j] == pytest.approx(expected, rel=1e-8, abs=1e-9)


def test_a_message_beyond_all_numbers_is_infinitely_far():
    payload, _, _ = information(np.random.default_rng(1), 1)
    reader = InformationPayloads(3, 6)
    assert reader.distance(payload, np.full((1, 1, 27), 1e300)).tolist() == [[np.inf]]


@pytest.mark.parametrize("trim", [1, 2])
def test_the_farthest_messages_are_left_out_and_the_result_is_their_weighted_mean(trim):
    random = np.random.default_rng(3)
    lists = graph(7)
    payload, _, _ = information(random, 7)
    weights, reader = metropolis_weights(lists), InformationPayloads(3, 6)
    delivered = lists.present & (random.random(lists.present.shape) > 0.2)
    stage = TrimmedMessages(weights, trim, reader.distance)
    mixed = stage.mix(stage.start(payload)[lists.index], delivered)
    for agent in range(7):
        heard = [(lists.index[agent, place], weights[agent, place]) for place in np.flatnonzero(delivered[agent])]
        distance = {other: reader.distance(payload[[agent]], payload[[other]][None])[0, 0] for other, _ in heard}
        kept = sorted(heard, key=lambda pair: distance[pair[0]])[: max(0, len(heard) - trim)]
        expected = (1.0 - sum(weight for _, weight in kept)) * payload[agent]
        expected = expected + sum(weight * payload[other] for other, weight in kept)
        np.testing.assert_allclose(mixed[agent], expected, atol=1e-12)


def test_without_liars_two_halves_of_the_information_are_read_as_their_sum():
    payload, states, matrices = information(np.random.default_rng(5), 2)
    halves = np.concatenate([0.25 * payload, 0.25 * payload], axis=1)
    single, double = InformationPayloads(3, 6), InformationPayloads(3, 6, (1.0, 3.0))
    np.testing.assert_allclose(
        double.distance(halves, halves[None].repeat(2, axis=0)),
        single.distance(payload, payload[None].repeat(2, axis=0)),
    )
    moved = double.displaced(halves, np.array([[1.0, 2.0, 3.0]] * 2))
    total = moved[:, :27] + 3.0 * moved[:, 27:]
    for agent in range(2):
        state = np.linalg.solve(matrices[agent], total[agent, :6])
        np.testing.assert_allclose(state - states[agent], [1, 2, 3, 0, 0, 0], atol=1e-9)
    np.testing.assert_array_equal(moved[:, 6:27], halves[:, 6:27])


def test_a_state_is_displaced_along_the_axes_it_has():
    state = np.arange(8.0).reshape(2, 4)
    moved = StatePayloads(2).displaced(state, np.array([[1.0, 2.0, 9.0], [0.0, -1.0, 9.0]]))
    assert (moved - state).tolist() == [[1, 2, 0, 0], [0, -1, 0, 0]]


def test_an_empty_place_among_the_neighbours_is_not_what_is_trimmed():
    # Two neighbours and an empty place, which holds what is farthest away; of the messages that of the liar is.
    stage = TrimmedMessages(np.array([[0.25, 0.25, 0.0]]), 1, lambda own, sent: np.abs(sent - own[:, None])[:, :, 0])
    stage.start(np.array([[0.0]]))
    found = stage.mix(np.array([[[10.0], [1.0], [1e6]]]), None)
    np.testing.assert_allclose(found, [[0.25]])
