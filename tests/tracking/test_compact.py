"""Payloads in few bits: all readers see one value, rounding twice changes nothing, and no estimate moves by it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from zenoh_cbef.tracking.compact import FLOAT32, PRECISIONS, Compact
from zenoh_cbef.tracking.linalg import unpack_upper

LAYOUTS = [((6,), 31), ((4,), 14), ((6, 7), 65), ((), 6)]
FEWER = PRECISIONS[1:]


def information(rng, size, count, *, conditions, place):
    """Vectors and upper triangles of matrices of all scales, of states as far off as `place` powers of ten."""
    root = rng.normal(size=(count, size, size)) * 10.0 ** rng.uniform(-3, 3, size=(count, 1, size))
    matrix = np.swapaxes(root, 1, 2) @ root
    scale = np.sqrt(np.einsum("nii->ni", matrix))
    matrix += 10.0**-conditions * np.einsum("ni,ij->nij", scale**2, np.eye(size))
    state = rng.normal(size=(count, size)) * 10.0**place / scale
    vector = np.einsum("nij,nj->ni", matrix, state)
    return state, matrix, np.concatenate([vector, matrix[:, *np.triu_indices(size)]], axis=1)


def payloads(blocks, width, *, seed, count=5, conditions=1, place=2):
    rng = np.random.default_rng(seed)
    parts = [information(rng, size, count, conditions=conditions, place=place)[2] for size in blocks]
    return np.concatenate([*parts, rng.normal(size=(count, width))], axis=1)[:, :width]


SOME = st.builds(
    lambda layout, **how: (*layout, payloads(*layout, **how)),
    st.sampled_from(LAYOUTS),
    seed=st.integers(0, 10**6),
    conditions=st.integers(0, 9),
    place=st.integers(-2, 9),
)
ANY = st.builds(
    lambda layout, values: (*layout, np.resize(values, (3, layout[1]))),
    st.sampled_from(LAYOUTS),
    st.lists(st.floats(-1e60, 1e60), min_size=1, max_size=195),
)


@pytest.mark.slow
@pytest.mark.parametrize("precision", FEWER)
@given(some=SOME | ANY)
@examples(60)
def test_sender_and_receivers_take_a_payload_for_the_same_and_rounding_twice_is_rounding_once(precision, some):
    blocks, width, payload = some
    compact = Compact(width, blocks, precision)
    rounded = compact.rounded(payload)
    assert compact.unpack([compact.pack(row) for row in payload]).tobytes() == rounded.tobytes()
    assert compact.unpack(compact.pack_all(rounded)).tobytes() == rounded.tobytes()
    assert compact.rounded(rounded).tobytes() == rounded.tobytes()
    for row, expected in zip(payload, rounded, strict=True):
        assert compact.rounded(row[None]).tobytes() == expected.tobytes()


def test_what_was_rounded_stays_in_its_layout_though_a_shorter_one_is_sound_for_it_now():
    # In eight bits c = 60.5 + rounds to 61 units, which is too near to singular, and 60.5 to 60, which is not.
    unit, rng = 2.0**-7, np.random.default_rng(2)
    entries = unit * np.array([64.0, 60.5 + 1e-6, 67.0])
    edge = np.concatenate([[0.0, 0.0], entries, [3.0]])[None]
    plain = payloads((2,), 6, seed=2, conditions=0)[:1]
    compact = Compact(6, (2,), "int8")
    payload = np.concatenate([plain, edge, plain + 1e-3 * rng.normal(size=plain.shape)])
    rounded = compact.rounded(payload)
    np.testing.assert_allclose(rounded[1, 2:5], unit * np.array([64.0, 60.5, 67.0]))
    assert compact.rounded(rounded).tobytes() == rounded.tobytes()
    assert compact.pack_all(rounded) == compact.pack_all(payload)


@pytest.mark.parametrize(("precision", "apart"), [("int16", 1e-3), ("int12", 0.03), ("int8", 0.4)])
@given(seed=st.integers(0, 10**6), place=st.integers(-1, 5))
@examples(40)
def test_a_rounded_matrix_moves_no_state_however_far_off_and_stays_positive(precision, apart, seed, place):
    state, matrix, payload = information(np.random.default_rng(seed), 6, 4, conditions=0, place=place)
    rounded = Compact(27, (6,), precision).rounded(payload)
    vector, told = rounded[:, :6], unpack_upper(rounded[:, 6:], 6)
    deviation = 1.0 / np.sqrt(np.einsum("nii->ni", matrix))
    found = np.linalg.solve(told, vector[:, :, None])[:, :, 0]
    assert (np.abs(found - state) <= deviation / 32.0 + 1e-9 * np.abs(state)).all()
    root = np.linalg.inv(np.linalg.cholesky(matrix))
    ratios = np.linalg.eigvalsh(root @ told @ np.swapaxes(root, 1, 2))
    assert (ratios > 0.0).all()
    assert (np.abs(ratios - 1.0) <= apart).all()


def test_messages_have_the_promised_size_and_one_that_integers_cannot_hold_is_in_float32():
    good = payloads((6,), 31, seed=1, conditions=0)
    sizes = {one: len(Compact(31, (6,), one).pack(good[0])) for one in FEWER}
    assert sizes == {one: Compact(31, (6,), one).size for one in FEWER}
    assert sizes == {"float32": 125, "int16": 73, "int12": 64, "int8": 52}
    compact = Compact(31, (6,), "int12")
    singular, far = good[:1].copy(), payloads((6,), 31, seed=1, place=9)
    singular[:, 6:27] = 0.0
    assert compact.pack(singular)[0] == compact.pack(far[0])[0] == FLOAT32
    assert len(compact.pack(payloads((6,), 31, seed=1, place=4)[0])) == compact.size + 12


@given(st.binary(max_size=140) | st.builds(bytes.__add__, st.sampled_from([b"\x0c", b"\x0d", b"\x20"]), st.binary()))
@examples(200)
def test_bytes_that_are_no_payload_are_refused_and_others_are_finite(data):
    compact = Compact(31, (6,), "int12")
    try:
        found = compact.unpack([data])
    except ValueError:
        return
    assert found.shape == (1, 31)
    assert np.isfinite(found).all()


@pytest.mark.parametrize("power", [206, -206])
def test_numbers_that_are_too_far_apart_for_integers_travel_as_floats(power):
    for far in (0, 1):
        matrix = np.eye(2)
        matrix[far, far] = 2.0**power
        payload = np.concatenate([matrix @ [1.0, 1.0], matrix[np.triu_indices(2)]])[None]
        rounded = Compact(5, (2,), "int16").rounded(payload)
        # Floats of 32 bits go so far.
        np.testing.assert_allclose(rounded, np.minimum(payload, 3e38), rtol=1e-3, atol=1e-37)
