"""Consensus weights make symmetric matrices whose rows sum to one."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.tracking.graph import make_edges, neighbours
from zenoh_cbef.tracking.weights import metropolis_weights, spectrum_bounds, uniform_weights, weight_matrix


def graph(kind, count, seed=1):
    places = np.zeros((count, 3))
    edges = make_edges(kind, places, seed=seed, probability=0.4, radius=1.0)
    return edges, neighbours(count, edges)


GRAPHS = [
    ("ring", 5),
    ("path", 4),
    ("star", 6),
    ("grid", 7),
    ("complete", 5),
    ("erdos-renyi", 9),
    ("path", 2),
]


@pytest.mark.parametrize(("kind", "count"), GRAPHS)
def test_uniform_weights_are_the_identity_less_epsilon_times_the_laplacian(kind, count):
    edges, lists = graph(kind, count)
    laplacian = np.zeros((count, count))
    for first, second in edges.tolist():
        laplacian[first, second] = laplacian[second, first] = -1.0
        laplacian[first, first] += 1.0
        laplacian[second, second] += 1.0
    epsilon = 0.1
    matrix = weight_matrix(lists, uniform_weights(lists, epsilon))
    np.testing.assert_allclose(matrix, np.eye(count) - epsilon * laplacian, rtol=0, atol=1e-15)


@pytest.mark.parametrize(("kind", "count"), GRAPHS)
def test_metropolis_weights_follow_their_formula(kind, count):
    edges, lists = graph(kind, count)
    degree = np.bincount(edges.ravel(), minlength=count)
    expected = np.zeros((count, count))
    for first, second in edges.tolist():
        weight = 1.0 / (1.0 + max(degree[first], degree[second]))
        expected[first, second] = expected[second, first] = weight
    expected += np.diag(1.0 - expected.sum(axis=1))
    matrix = weight_matrix(lists, metropolis_weights(lists))
    np.testing.assert_allclose(matrix, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize(("kind", "count"), GRAPHS)
@pytest.mark.parametrize("weights", ["uniform", "metropolis"])
def test_weight_matrices_are_symmetric_stochastic_and_contract_to_the_average(kind, count, weights):
    _, lists = graph(kind, count)
    limit = 1.0 / (lists.degree.max() + 1.0)
    chosen = uniform_weights(lists, limit) if weights == "uniform" else metropolis_weights(lists)
    matrix = weight_matrix(lists, chosen)
    np.testing.assert_array_equal(matrix, matrix.T)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, rtol=0, atol=1e-15)
    assert (np.diag(matrix) > 0.0).all()
    low, high = spectrum_bounds(matrix)
    assert -1.0 < low <= high < 1.0
    deviation = matrix - 1.0 / count
    assert max(abs(low), abs(high)) == pytest.approx(np.linalg.norm(deviation, 2), abs=1e-12)


def test_padding_has_no_weight():
    _, lists = graph("star", 5)
    assert (metropolis_weights(lists)[~lists.present] == 0.0).all()
    assert (uniform_weights(lists, 0.2)[~lists.present] == 0.0).all()


def test_spectrum_bounds_of_known_graphs():
    _, lists = graph("complete", 4)
    assert spectrum_bounds(weight_matrix(lists, uniform_weights(lists, 0.25))) == pytest.approx((0.0, 0.0), abs=1e-12)
    _, lists = graph("ring", 6)
    matrix = weight_matrix(lists, uniform_weights(lists, 0.3))
    eigenvalues = sorted(1.0 - 0.6 * (1.0 - np.cos(2.0 * np.pi * k / 6)) for k in range(6))
    assert spectrum_bounds(matrix) == pytest.approx((eigenvalues[0], eigenvalues[-2]))
    assert spectrum_bounds(np.ones((1, 1))) == (0.0, 0.0)
