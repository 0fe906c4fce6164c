"""Batched linear algebra whose rows come out the same, bit for bit, in every batch size."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats

LEAST = 1e-12
"""Least over largest eigenvalue of what passes for an information matrix."""


def matvec(matrix: Floats, vector: Floats) -> Floats:
    """Matrix times vector per row: (..., r, c) by (n, c) gives (n, r)."""
    return np.asarray((matrix @ vector[..., None])[..., 0])


def outer(left: Floats, right: Floats) -> Floats:
    """Outer product per row: (n, r) by (n, c) gives (n, r, c)."""
    return left[..., :, None] * right[..., None, :]


def inverse(matrices: Floats) -> Floats:
    """Inverse of symmetric positive definite matrices (n, s, s), symmetric to the last bit; NaN where one is singular.

    A tracker finds an agent's NaN and refuses its update; an error would end the others of a batch, too.
    """
    inverted = raw_inverse(matrices)
    doubled = inverted + inverted.swapaxes(-1, -2)
    doubled *= 0.5
    return np.asarray(doubled)


def raw_inverse(matrices: Floats) -> Floats:
    """The same, not made symmetric."""
    return _each(np.linalg.inv, matrices.shape, matrices)


def solve(matrices: Floats, right: Floats) -> Floats:
    """A^-1 B of matrices (n, s, s) and (n, s, k), NaN where A is singular."""
    return _each(np.linalg.solve, right.shape, matrices, right)


def _each(compute: Callable[..., NDArray[np.generic]], shape: tuple[int, ...], *given: Floats) -> Floats:
    """What LAPACK computes, row by row of arrays that are given; a row of which it cannot is NaN."""
    try:
        return np.asarray(compute(*given), dtype=np.float64)
    except np.linalg.LinAlgError:
        found = np.full(shape, np.nan)
        for place, rows in enumerate(zip(*given, strict=True)):
            with suppress(np.linalg.LinAlgError):
                found[place] = compute(*rows)
        return found


@dataclass(frozen=True)
class Inversion:
    """How a filter inverts information matrices and covariances: by the library."""

    def inverse(self, matrices: Floats) -> Floats:
        """As the function `inverse`, of symmetric matrices (n, s, s)."""
        return inverse(matrices)

    def if_definite(self, matrices: Floats) -> Floats | None:
        """The inverses of symmetric matrices (n, s, s); None unless all of them are positive definite."""
        try:
            np.linalg.cholesky(matrices)
            return inverse(matrices)
        except np.linalg.LinAlgError:
            return None

    def information(self, rows: Floats, noise: Floats, values: Floats) -> tuple[Floats, Floats]:
        """What values (n, k) of covariance (n, k, k) tell of x: H^T R^-1 y (n, s) and H^T R^-1 H (n, s, s).

        rows: H, (n, k, s).
        """
        gain = rows.swapaxes(1, 2) @ inverse(noise)
        return matvec(gain, values), gain @ rows


BY_LIBRARY = Inversion()


def leading_trace(matrices: Floats, size: int) -> Floats:
    """Sums (...) of the first elements of diagonals, of matrices (..., >= size, >= size), always in this order."""
    total = matrices[..., 0, 0]
    for place in range(1, size):
        total = total + matrices[..., place, place]
    return total


def sound_rows(matrices: Floats) -> Bools:
    """Which of symmetric matrices (n, s, s) pass for information matrices: (n,)."""
    eigenvalues = _each(np.linalg.eigvalsh, matrices.shape[:2], matrices)
    return np.asarray(eigenvalues[:, 0] > LEAST * eigenvalues[:, -1])


def neighbour_sum(terms: Floats) -> Floats:
    """Sum over the neighbour axis (axis 1) of (n, m) or (n, m, d) in ascending neighbour order.

    NumPy regroups a sum along the last axis, so a padded batch would differ from a batch of one in the last bits;
    along an earlier axis it adds row by row. Starting from 0.0 makes padding (exact zeros) invisible: no partial
    sum is -0.0.
    """
    if terms.ndim == 2:
        return neighbour_sum(terms[:, :, None])[:, 0]
    if terms.shape[2] == 1:
        return neighbour_sum(np.repeat(terms, 2, axis=2))[:, :1]
    total: Floats = np.add.reduce(terms, axis=1, initial=0.0)
    return total


@cache
def upper(size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Where the upper triangle stands in a matrix laid out flat, and where each entry of the matrix stands in it."""
    rows, columns = np.triu_indices(size)
    place = np.empty((size, size), dtype=np.intp)
    place[rows, columns] = place[columns, rows] = np.arange(len(rows))
    return rows * size + columns, place.ravel()


def pack_upper(matrices: Floats) -> Floats:
    """The upper triangles of symmetric matrices, row by row: (n, s, s) to (n, s(s+1)/2)."""
    count, size, _ = matrices.shape
    return matrices.reshape(count, size * size).take(upper(size)[0], axis=1)


def unpack_upper(packed: Floats, size: int) -> Floats:
    """Inverse of pack_upper: (n, s(s+1)/2) to (n, s, s)."""
    return packed.take(upper(size)[1], axis=1).reshape(len(packed), size, size)
