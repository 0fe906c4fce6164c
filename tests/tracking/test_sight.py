"""What the places of agents leave open does not depend on where, how turned or how fast drifting one looks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.tracking.sight import open_axes

STEPS = 12
RESOLUTION = 0.1
COUPLE = [[0, 0, 0], [10, 0, 0]]
TRIPLE = [*COUPLE, [0, 10, 0]]


def left_open(places, axes=3):
    """Of agents that stand still."""
    resting = np.repeat(np.array(places, dtype=float)[:, None, :axes], STEPS, axis=1)
    [found] = open_axes(resting, np.ones(resting.shape[:2], dtype=bool), STEPS, RESOLUTION)
    return found


def test_where_no_agent_ranges_all_axes_are_open_in_every_window():
    found = open_axes(np.zeros((2, STEPS, 3)), np.zeros((2, STEPS), dtype=bool), 5, RESOLUTION)
    assert found.tolist() == [3] * (STEPS - 4)


@pytest.mark.parametrize(
    ("places", "in_space", "in_a_plane"),
    [
        ([[1, 2, 3]], 3, 2),
        (COUPLE, 2, 1),
        ([*COUPLE, [5, 0, 0], [7, 0, 0]], 2, 1),
        (TRIPLE, 1, 0),
        ([*TRIPLE, [10, 10, 0]], 1, 0),
        ([*TRIPLE, [0, 0, 10]], 0, 0),
        ([[0, 0, 0], [0, 0, 9]], 2, 2),
        ([*COUPLE, [5, 0.001, 0]], 2, 1),
    ],
)
def test_agents_that_rest_leave_open_what_they_do_not_span(places, in_space, in_a_plane):
    assert (left_open(places), left_open(places, axes=2)) == (in_space, in_a_plane)


def test_who_has_no_range_counts_for_nothing_and_none_leave_all_open():
    places = np.repeat(np.array(TRIPLE, dtype=float)[:, None], 30, axis=1)
    there = np.ones((3, 30), dtype=bool)
    there[2, 10:] = False
    places[2, 10:] = np.nan
    assert open_axes(places, there, 5, RESOLUTION).tolist() == [1] * 10 + [2] * 16
    assert open_axes(places, np.zeros_like(there), 5, RESOLUTION).tolist() == [3] * 26


def test_one_agent_that_turns_sees_more_than_one_that_goes_straight():
    time = np.arange(STEPS, dtype=float)
    straight = np.stack([2 * time, 0 * time, 0 * time], axis=1)[None]
    turning = np.stack([2 * time, time**2, 0 * time], axis=1)[None]
    helix = np.stack([5 * np.cos(time), 5 * np.sin(time), time**2], axis=1)[None]
    there = np.ones((1, STEPS), dtype=bool)
    found = [open_axes(one, there, STEPS, RESOLUTION)[0] for one in (straight, turning, helix)]
    assert found == [3, 2, 0]


numbers = st.integers(-9, 9)
vectors = st.tuples(numbers, numbers, numbers)


@given(
    st.lists(vectors, min_size=1, max_size=6),
    st.lists(st.booleans(), min_size=6 * STEPS, max_size=6 * STEPS),
    st.integers(0, 2**32 - 1),
    vectors,
    vectors,
)
def test_rotation_translation_and_common_drift_change_no_verdict(places, there, seed, shift, drift):
    resting = np.repeat(np.array(places, dtype=float)[:, None], STEPS, axis=1)
    present = np.array(there).reshape(6, STEPS)[: len(places)]
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    moved = resting @ turn.T + np.array(shift) * 10.0 + np.arange(STEPS)[:, None] * np.array(drift, dtype=float)
    # An integer place leaves a line by a tenth or more where it leaves it at all, arithmetic by a millionth.
    before, after = (open_axes(one, present, 4, 1e-3) for one in (resting, moved))
    np.testing.assert_array_equal(before, after)
