"""Small matrices are inverted by the same operations alone and in a batch, as well as by the library."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.elimination import BY_ELIMINATION
from zenoh_cbef.tracking.linalg import BY_LIBRARY

SIZES = range(1, 7)
ROUNDING = np.finfo(np.float64).eps


def matrices(random, count, size, spread=1.0):
    """Symmetric positive definite ones, whose condition numbers are up to that of 10^(2 spread)."""
    turned, _ = np.linalg.qr(random.normal(size=(count, size, size)))
    found = turned * 10.0 ** random.uniform(-spread, spread, (count, 1, size)) @ turned.swapaxes(1, 2)
    return 0.5 * (found + found.swapaxes(1, 2))


def exact(matrix):
    """The inverse of a matrix of floats, by fractions."""
    size = len(matrix)
    rows = [
        [Fraction(x) for x in row] + [Fraction(i == j) for j in range(size)] for i, row in enumerate(matrix.tolist())
    ]
    for k in range(size):
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(size):
            if i != k:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return np.array([[float(x) for x in row[size:]] for row in rows])


@pytest.mark.parametrize("size", SIZES)
def test_a_matrix_has_the_same_inverse_in_every_batch(size):
    batch = matrices(np.random.default_rng(size), 50, size, 3.0)
    batch[[3, 40]] *= -1.0
    batch[[5, 41]] = np.nan
    whole = BY_ELIMINATION.inverse(batch)
    for count in (1, 2, 23, 24, 31):
        parts = [BY_ELIMINATION.inverse(batch[start : start + count]) for start in range(0, 50, count)]
        assert np.concatenate(parts).tobytes() == whole.tobytes()


@settings(deadline=None)
@given(st.sampled_from(SIZES), st.floats(0.0, 6.0), st.floats(-6.0, 6.0), st.integers(0, 2**32 - 1))
def test_an_inverse_is_as_exact_as_the_condition_of_the_matrix_allows(size, spread, scale, seed):
    matrix = matrices(np.random.default_rng(seed), 1, size, spread) * 10.0**scale
    inverted = BY_ELIMINATION.inverse(matrix)
    np.testing.assert_array_equal(inverted, inverted.swapaxes(1, 2))
    truth = exact(matrix[0])
    error = np.linalg.norm(inverted[0] - truth) / np.linalg.norm(truth)
    assert error <= 2.0 * ROUNDING * np.linalg.cond(matrix[0])


@settings(deadline=None)
@given(st.sampled_from(SIZES), st.lists(st.integers(-20, 20), min_size=6, max_size=6), st.integers(0, 2**32 - 1))
def test_units_of_the_unknowns_do_not_matter(size, powers, seed):
    matrix, unit = matrices(np.random.default_rng(seed), 1, size), 2.0 ** np.array(powers[:size])
    scaled = BY_ELIMINATION.inverse(matrix * unit * unit[:, None])
    np.testing.assert_array_equal(scaled * unit * unit[:, None], BY_ELIMINATION.inverse(matrix))


@pytest.mark.parametrize("count", [3, 40])
@pytest.mark.parametrize("size", SIZES)
def test_what_is_not_positive_definite_goes_the_way_of_the_library(size, count):
    batch = matrices(np.random.default_rng(size), count, size)
    assert BY_ELIMINATION.if_definite(batch) is not None
    for wrong in (-batch[0], batch[0] - 20.0 * np.eye(size), np.full((size, size), np.nan)):
        tried = batch.copy()
        tried[1] = wrong
        assert BY_ELIMINATION.if_definite(tried) is None
        assert BY_ELIMINATION.inverse(tried)[1].tobytes() == BY_LIBRARY.inverse(tried)[1].tobytes()
        assert BY_ELIMINATION.inverse(tried)[2].tobytes() == BY_ELIMINATION.inverse(batch)[2].tobytes()
    batch[1] = 0.0
    assert BY_LIBRARY.if_definite(batch) is None
    assert BY_ELIMINATION.if_definite(batch) is None
    assert np.isnan(BY_ELIMINATION.inverse(batch)[1]).all()


def test_larger_matrices_are_the_librarys():
    large = matrices(np.random.default_rng(1), 30, 7)
    assert BY_ELIMINATION.inverse(large).tobytes() == BY_LIBRARY.inverse(large).tobytes()
    found = BY_ELIMINATION.if_definite(large)
    assert found is not None
    assert found.tobytes() == BY_LIBRARY.inverse(large).tobytes()
    assert BY_ELIMINATION.if_definite(-large) is None


def test_what_values_tell_is_the_same_with_and_without_an_inverse():
    random = np.random.default_rng(1)
    rows, noise, values = random.normal(size=(5, 9, 4)), matrices(random, 5, 9), random.normal(size=(5, 9))
    for found, expected in zip(
        BY_ELIMINATION.information(rows, noise, values), BY_LIBRARY.information(rows, noise, values), strict=True
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)
    alone = [BY_ELIMINATION.information(rows[[one]], noise[[one]], values[[one]]) for one in range(5)]
    for part, found in enumerate(BY_ELIMINATION.information(rows, noise, values)):
        assert np.concatenate([one[part] for one in alone]).tobytes() == found.tobytes()


def test_the_rules_choose_how_matrices_are_inverted():
    today, before = (Plan(load("tracking", [f"filter.defaults={rules}"]).scenario) for rules in (15, 14))
    assert (today.settings.inversion, before.settings.inversion) == (BY_ELIMINATION, BY_LIBRARY)


@pytest.mark.parametrize("part", [["steps=15"], ["steps=15", "filter.start='given'"]])
def test_first_fix_and_filter_come_out_as_by_the_rules_before_but_for_rounding(part):
    today, before = (
        simulate([load("tracking", [*part, f"filter.defaults={rules}"]).scenario])[0].estimates for rules in (15, 14)
    )
    np.testing.assert_allclose(today, before, rtol=1e-9, atol=1e-9)
    assert (today != before).any(axis=(0, 2)).sum() > 10
