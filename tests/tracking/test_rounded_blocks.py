"""A block of information in integers: which ones, which are sound, and which were rounded before."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.tracking.compact import _block


def block(entries, bits, unit, scale=1.0):
    """A matrix of so many units, of states with this scale, at the origin."""
    matrix = scale**2 * unit * np.array([entries], dtype=float)
    return _block(np.zeros((1, matrix.shape[1])), matrix, bits)


def test_a_diagonal_stays_above_a_quarter_so_that_its_power_stays():
    for scale in (1.0, 8.0):
        found = block([[32]], 8, 2.0**-7, scale)
        assert (found.entries.tolist(), found.power.tolist()) == ([[33]], [[int(np.log2(scale))]])
    assert block([[33]], 8, 2.0**-7).entries.tolist() == [[33]]
    assert block([[127]], 8, 2.0**-7).entries.tolist() == [[127]]


def test_a_matrix_is_sound_while_its_least_eigenvalue_is_beyond_the_rounding():
    # Of [[64, c], [c, 65]] it is 5.5 units for c = 59, and 4.5 for c = 60; two states need five.
    assert [bool(block([[64, c], [c, 65]], 8, 2.0**-7).sound[0]) for c in (59, 60)] == [True, False]


def test_a_block_was_rounded_before_where_it_is_one_in_the_finest_integers():
    assert [bool(block([[number]], 8, 2.0**-16).whole[0]) for number in (40_002, 40_001)] == [True, False]
    assert [bool(block([[number]], 16, 2.0**-15).whole[0]) for number in (20_001, 20_000.5)] == [True, False]
