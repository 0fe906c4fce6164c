"""Consensus is a power of W, or a polynomial in it, in any batch; lost messages leave the own value."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial.chebyshev import Chebyshev as Polynomial

from tests.examples import examples
from zenoh_cbef.tracking.consensus import Average, Chebyshev, RunningSums
from zenoh_cbef.tracking.graph import canonical_edges, make_edges, neighbours, stack
from zenoh_cbef.tracking.weights import metropolis_weights, spectrum_bounds, uniform_weights, weight_matrix

LINEAR = ("average", "chebyshev")
SCHEMES = (*LINEAR, "running-sums")


def graph(kind="erdos-renyi", count=7, seed=2):
    return neighbours(count, make_edges(kind, np.zeros((count, 3)), seed=seed, probability=0.4, radius=1.0))


def stage(scheme, lists, weights=None):
    chosen = metropolis_weights(lists) if weights is None else weights
    if scheme == "average":
        return Average(chosen)
    if scheme == "running-sums":
        return RunningSums(lists.present)
    low, high = spectrum_bounds(weight_matrix(lists, chosen))
    return Chebyshev(chosen, np.full((len(chosen), 1), low), np.full((len(chosen), 1), high))


def run(consensus, lists, payload, rounds, delivered=None):
    message = consensus.start(payload)
    for round_ in range(rounds):
        flags = delivered[round_] if delivered is not None else None
        message = consensus.mix(message[lists.index], flags)
    return consensus.result()


@pytest.mark.parametrize("kind", ["ring", "path", "star", "complete", "erdos-renyi"])
@pytest.mark.parametrize("rounds", [0, 1, 2, 5, 20])
def test_averaging_is_a_power_of_the_weight_matrix(kind, rounds):
    lists = graph(kind)
    payload = np.random.default_rng(3).normal(size=(7, 4))
    for weights in (metropolis_weights(lists), uniform_weights(lists, 1.0 / (lists.degree.max() + 1.0))):
        expected = np.linalg.matrix_power(weight_matrix(lists, weights), rounds) @ payload
        np.testing.assert_allclose(run(Average(weights), lists, payload, rounds), expected, rtol=0, atol=1e-13)


def test_uniform_averaging_is_the_papers_iteration():
    lists, epsilon = graph(), 0.12
    state = np.random.default_rng(4).normal(size=(7, 6))
    expected = state.copy()
    for _ in range(10):
        before = expected.copy()
        for agent in range(7):
            for other in lists.row(agent).index[0]:
                expected[agent] -= epsilon * (before[agent] - before[other])
    mixed = run(Average(uniform_weights(lists, epsilon)), lists, state, 10)
    np.testing.assert_allclose(mixed, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("kind", ["ring", "path", "star", "erdos-renyi"])
@pytest.mark.parametrize("rounds", [0, 1, 2, 3, 6, 15])
def test_acceleration_is_the_scaled_chebyshev_polynomial_of_the_weight_matrix(kind, rounds):
    lists = graph(kind)
    payload = np.random.default_rng(5).normal(size=(7, 3))
    matrix = weight_matrix(lists, metropolis_weights(lists))
    low, high = spectrum_bounds(matrix)
    polynomial = Polynomial.basis(rounds)
    values, vectors = np.linalg.eigh((2.0 * matrix - (high + low) * np.eye(7)) / (high - low))
    scale = polynomial((2.0 - high - low) / (high - low))
    expected = vectors @ np.diag(polynomial(values) / scale) @ vectors.T @ payload
    np.testing.assert_allclose(run(stage("chebyshev", lists), lists, payload, rounds), expected, rtol=0, atol=1e-11)


def test_acceleration_on_a_complete_graph_divides_by_nothing():
    lists = graph("complete")
    payload = np.random.default_rng(6).normal(size=(7, 3))
    mixed = run(stage("chebyshev", lists), lists, payload, 3)
    np.testing.assert_allclose(mixed, np.tile(payload.mean(axis=0), (7, 1)), atol=1e-6)


def test_acceleration_does_not_overflow_in_many_rounds():
    lists = graph("path")
    payload = np.random.default_rng(7).normal(size=(7, 2))
    mixed = run(stage("chebyshev", lists), lists, payload, 3000)
    np.testing.assert_allclose(mixed, np.tile(payload.mean(axis=0), (7, 1)), atol=1e-9)


def test_acceleration_brings_agents_nearer_to_the_average_than_plain_rounds():
    lists = graph("path")
    payload = np.random.default_rng(8).normal(size=(7, 1))
    plain, fast = (np.ptp(run(stage(scheme, lists), lists, payload, 12)) for scheme in LINEAR)
    assert fast < 0.5 * plain


@pytest.mark.parametrize("scheme", LINEAR)
def test_the_average_is_preserved_where_nothing_is_lost(scheme):
    lists = graph("grid", 8)
    payload = np.random.default_rng(9).normal(size=(8, 5))
    for rounds in (1, 2, 7):
        mixed = run(stage(scheme, lists), lists, payload, rounds)
        np.testing.assert_allclose(mixed.mean(axis=0), payload.mean(axis=0), rtol=0, atol=1e-14)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_agents_that_agree_stay_where_they_are_whatever_is_lost(scheme):
    lists = graph()
    payload = np.tile([1.0, -2.5, 1e-3], (7, 1))
    delivered = np.random.default_rng(10).random((9, *lists.index.shape)) < 0.5
    mixed = run(stage(scheme, lists), lists, payload, 9, delivered & lists.present)
    np.testing.assert_allclose(mixed, payload, rtol=1e-13)


def test_a_lost_message_returns_its_weight_to_the_diagonal():
    lists = graph("complete", 4)
    weights = metropolis_weights(lists)
    payload = np.random.default_rng(11).normal(size=(4, 2))
    delivered = lists.present.copy()
    delivered[1, 0] = delivered[3, 2] = False
    matrix = weight_matrix(lists, np.where(delivered, weights, 0.0))
    mixed = run(Average(weights), lists, payload, 1, [delivered])
    np.testing.assert_allclose(mixed, matrix @ payload, rtol=0, atol=1e-15)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_what_a_lost_message_holds_does_not_matter(scheme):
    lists = graph("ring", 5)
    payload = np.random.default_rng(12).normal(size=(5, 3))
    delivered = lists.present.copy()
    delivered[2, 1] = False
    results = []
    for garbage in (0.0, 1e300, -np.inf, np.nan):
        consensus = stage(scheme, lists)
        received = consensus.start(payload)[lists.index]
        received[2, 1] = garbage
        with np.errstate(invalid="ignore"):
            results.append(consensus.mix(received, delivered).tobytes())
    assert len(set(results)) == 1


VALUES = st.sampled_from([0.0, -0.0, 1.0, -1.0, 1e-300, -1e-300, 0.1, -0.1, 1e17, 3.0, 1 / 3])


@st.composite
def exchanges(draw):
    """Several graphs, payloads with signed zeros, and what is delivered in each round."""
    several = []
    for _ in range(draw(st.integers(1, 3))):
        count = draw(st.integers(1, 6))
        pairs = [(first, second) for first in range(count) for second in range(first + 1, count)]
        several.append(neighbours(count, canonical_edges(draw(st.lists(st.sampled_from(pairs))) if pairs else [])))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    pool = draw(st.lists(VALUES, min_size=1, max_size=8))
    total = sum(len(one.index) for one in several)
    mixed = np.where(random.random((total, 4)) < 0.7, random.choice(pool, (total, 4)), random.normal(size=(total, 4)))
    return several, mixed, draw(st.sampled_from(SCHEMES)), draw(st.sampled_from([0.0, 0.3, 1.0])), random


@examples(50)
@given(exchanges())
def test_an_agent_alone_computes_the_bits_of_the_batch(exchange):
    several, payload, scheme, loss, random = exchange
    rounds, lists = 4, stack(several)
    weights = metropolis_weights(lists)
    low, high = np.full((len(payload), 1), -0.37), np.full((len(payload), 1), 0.81)
    delivered = (random.random((rounds, *lists.index.shape)) >= loss) & lists.present

    def make(rows):
        shown = lists.row(rows[0]).present if len(rows) == 1 else lists.present
        if scheme == "running-sums":
            return RunningSums(shown)
        chosen = weights[rows][:, lists.present[rows[0]]] if len(rows) == 1 else weights
        return Average(chosen) if scheme == "average" else Chebyshev(chosen, low[rows], high[rows])

    batch = make(range(len(payload)))
    alone = [make([agent]) for agent in range(len(payload))]
    message = batch.start(payload)
    single = np.concatenate([one.start(payload[[agent]]) for agent, one in enumerate(alone)])
    for flags in delivered:
        assert single.tobytes() == message.tobytes()
        message = batch.mix(message[lists.index], flags)
        single = np.concatenate(
            [
                one.mix(single[lists.row(agent).index], flags[[agent]][:, lists.present[agent]])
                for agent, one in enumerate(alone)
            ]
        )
    assert single.tobytes() == message.tobytes()
    assert np.concatenate([one.result() for one in alone]).tobytes() == batch.result().tobytes()


@settings(deadline=None)
@given(exchanges())
def test_no_flags_mean_that_all_was_delivered(exchange):
    several, payload, scheme, _, _ = exchange
    lists = stack(several)
    weights, bounds = metropolis_weights(lists), np.full((len(payload), 1), 0.9)
    makers = {
        "average": lambda: Average(weights),
        "chebyshev": lambda: Chebyshev(weights, -0.5 * bounds, bounds),
        "running-sums": lambda: RunningSums(lists.present),
    }
    consensus = [makers[scheme]() for _ in range(2)]
    everything = np.ones(lists.index.shape, dtype=bool)
    first = run(consensus[0], lists, payload, 3)
    assert first.tobytes() == run(consensus[1], lists, payload, 3, [everything] * 3).tobytes()


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_step_leaves_nothing_behind_for_the_next(scheme):
    lists = graph()
    payloads = np.random.default_rng(13).normal(size=(2, 7, 3))
    used = stage(scheme, lists)
    run(used, lists, payloads[0], 5)
    fresh = run(stage(scheme, lists), lists, payloads[1], 5)
    assert run(used, lists, payloads[1], 5).tobytes() == fresh.tobytes()
