"""Consensus weight matrices of a graph, as one weight per neighbour."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.graph import Neighbours


def uniform_weights(neighbours: Neighbours, epsilon: float) -> Floats:
    """The paper's constant step, W = I - epsilon Laplacian; (n, m), zero where padded."""
    return np.where(neighbours.present, epsilon, 0.0)


def metropolis_weights(neighbours: Neighbours) -> Floats:
    """w_ij = 1/(1 + max(d_i, d_j)) (Xiao, Boyd, Lall, IPSN 2005); (n, m), zero where padded."""
    degree = neighbours.degree
    largest = np.maximum(degree[:, None], degree[neighbours.index])
    return np.where(neighbours.present, 1.0 / (1.0 + largest), 0.0)


def weight_matrix(neighbours: Neighbours, weights: Floats) -> Floats:
    """The full W, (n, n), with what is not given to neighbours on its diagonal."""
    count, width = weights.shape
    matrix = np.zeros((count, count))
    rows = np.repeat(np.arange(count), width)
    np.add.at(matrix, (rows, neighbours.index.ravel()), weights.ravel())
    matrix[np.arange(count), np.arange(count)] += 1.0 - weights.sum(axis=1)
    return matrix


def spectrum_bounds(matrix: Floats) -> tuple[float, float]:
    """Least and largest eigenvalue of a symmetric W other than its leading 1."""
    values = np.linalg.eigvalsh(matrix)[:-1]
    return (float(values[0]), float(values[-1])) if len(values) else (0.0, 0.0)
