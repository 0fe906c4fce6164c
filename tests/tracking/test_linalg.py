"""Batched linear algebra gives every row the same bits in any batch."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.tracking.linalg import (
    inverse,
    matvec,
    neighbour_sum,
    outer,
    pack_upper,
    solve,
    sound_rows,
    unpack_upper,
)

RANDOM = np.random.default_rng(1)


def covariances(count, size):
    root = RANDOM.normal(size=(count, size, size))
    return root @ np.swapaxes(root, 1, 2) + np.eye(size)


def test_matvec_and_outer_are_the_products_of_each_row():
    matrices, vectors = RANDOM.normal(size=(5, 3, 4)), RANDOM.normal(size=(5, 4))
    expected = [
        [sum(a * x for a, x in zip(row, vector, strict=True)) for row in matrix]
        for matrix, vector in zip(matrices, vectors, strict=True)
    ]
    np.testing.assert_allclose(matvec(matrices, vectors), expected, rtol=1e-12, atol=1e-14)
    left = RANDOM.normal(size=(5, 3))
    assert outer(left, vectors)[2, 1, 3] == left[2, 1] * vectors[2, 3]


def test_inverse_is_symmetric_to_the_last_bit_and_inverts():
    matrices = covariances(20, 6)
    inverted = inverse(matrices)
    np.testing.assert_array_equal(inverted, np.swapaxes(inverted, 1, 2))
    np.testing.assert_allclose(matrices @ inverted, np.broadcast_to(np.eye(6), (20, 6, 6)), atol=1e-9)
    public = np.linalg.inv(matrices)
    assert inverted.tobytes() == (0.5 * (public + np.swapaxes(public, 1, 2))).tobytes()


@pytest.mark.parametrize("odd", [0.0, np.nan])
def test_a_matrix_without_an_inverse_leaves_the_others_of_a_batch_as_they_are(odd):
    matrices = covariances(3, 6)
    matrices[1] = odd
    found = inverse(matrices)
    assert np.isnan(found).any(axis=(1, 2)).tolist() == [False, True, False]
    assert found[::2].tobytes() == inverse(matrices[::2]).tobytes()


def test_equations_without_a_solution_leave_the_others_of_a_batch_as_they_are():
    matrices, right = covariances(3, 6), RANDOM.normal(size=(3, 6, 2))
    matrices[1] = 0.0
    found = solve(matrices, right)
    assert np.isnan(found[1]).all()
    np.testing.assert_array_equal(found[::2], np.linalg.solve(matrices[::2], right[::2]))


@pytest.mark.parametrize("odd", [np.inf, np.nan, 1e308])
def test_a_matrix_without_eigenvalues_is_unsound_and_the_others_of_a_batch_are_not(odd):
    matrices = np.stack([np.eye(6), np.full((6, 6), odd), 2.0 * np.eye(6), -np.eye(6)])
    np.testing.assert_array_equal(sound_rows(matrices), [True, False, True, False])


@pytest.mark.parametrize("size", [4, 6])
def test_rows_come_out_the_same_bits_alone_and_in_a_batch(size):
    matrices, vectors = covariances(37, size), RANDOM.normal(size=(37, size))
    common = RANDOM.normal(size=(size, size))
    for function in (
        matvec,
        lambda m, v: inverse(m),  # noqa: ARG005
        lambda m, v: matvec(common, v),  # noqa: ARG005
        lambda m, v: common @ m @ common.T,  # noqa: ARG005
        lambda m, v: outer(v, v),  # noqa: ARG005
    ):
        batch = function(matrices, vectors)
        alone = [function(matrices[[row]], vectors[[row]])[0] for row in range(37)]
        assert batch.tobytes() == np.array(alone).tobytes()


NUMBERS = st.floats(-1e6, 1e6).map(lambda value: value or -0.0)


@settings(deadline=None)
@given(st.lists(NUMBERS, max_size=12), st.integers(0, 20), st.integers(1, 3), st.integers(1, 5))
def test_neighbour_sum_runs_in_ascending_order_and_padding_is_invisible(terms, padding, rows, columns):
    expected = 0.0
    for term in terms:
        expected += term
    padded = np.array([*terms, *[0.0] * padding])
    flat = neighbour_sum(np.tile(padded, (rows, 1)))
    deep = neighbour_sum(np.tile(padded[:, None], (rows, 1, columns)))
    assert flat.tobytes() == np.full(rows, expected).tobytes()
    assert deep.tobytes() == np.full((rows, columns), expected).tobytes()


@settings(deadline=None)
@given(st.integers(1, 7), st.integers(1, 4))
def test_the_upper_triangle_holds_a_symmetric_matrix(size, count):
    matrices = covariances(count, size)
    matrices = 0.5 * (matrices + np.swapaxes(matrices, 1, 2))
    packed = pack_upper(matrices)
    assert packed.shape == (count, size * (size + 1) // 2)
    assert packed[0, :size].tolist() == matrices[0, 0].tolist()
    np.testing.assert_array_equal(unpack_upper(packed, size), matrices)
