"""Batched linear algebra whose rows come out the same, bit for bit, in every batch size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def matvec(matrix: Floats, vector: Floats) -> Floats:
    """Matrix times vector per row: (..., r, c) by (n, c) gives (n, r)."""
    return np.asarray((matrix @ vector[..., None])[..., 0])


def outer(left: Floats, right: Floats) -> Floats:
    """Outer product per row: (n, r) by (n, c) gives (n, r, c)."""
    return left[..., :, None] * right[..., None, :]


def inverse(matrices: Floats) -> Floats:
    """Inverse of symmetric positive definite matrices (n, s, s), symmetric to the last bit."""
    inverted = np.linalg.inv(matrices)
    return np.asarray(0.5 * (inverted + np.swapaxes(inverted, -1, -2)))


def neighbour_sum(terms: Floats) -> Floats:
    """Sum over the neighbour axis (axis 1) in ascending neighbour order.

    NumPy's own reductions may regroup a longer axis, so a padded batch would differ from a batch of one in the
    last bits; adding slot by slot makes padding (exact zeros) invisible.
    """
    total = np.zeros(terms.shape[:1] + terms.shape[2:])
    for slot in range(terms.shape[1]):
        total += terms[:, slot]
    return total


def pack_upper(matrices: Floats) -> Floats:
    """The upper triangles of symmetric matrices, row by row: (n, s, s) to (n, s(s+1)/2)."""
    rows, columns = np.triu_indices(matrices.shape[-1])
    return matrices[..., rows, columns]


def unpack_upper(packed: Floats, size: int) -> Floats:
    """Inverse of pack_upper: (n, s(s+1)/2) to (n, s, s)."""
    rows, columns = np.triu_indices(size)
    matrices = np.empty((*packed.shape[:-1], size, size))
    matrices[..., rows, columns] = packed
    matrices[..., columns, rows] = packed
    return matrices
