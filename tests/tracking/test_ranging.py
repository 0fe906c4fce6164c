"""Own ranges have the gradient they claim, and differenced rows are exact."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.tracking.ranging import Measurement, Space, differenced_rows, own_range

SPACES = [Space(), Space(1.5), Space(0.0)]
SEEDS = st.integers(0, 2**32 - 1)


def scene(seed, space, count=5):
    random = np.random.default_rng(seed)
    state = random.normal(scale=3.0, size=(count, 2 * space.axes))
    return state, random.normal(scale=3.0, size=(count, 3)), random.uniform(0.0, 0.5, count)


@settings(deadline=None, derandomize=True)
@given(SEEDS, st.sampled_from(SPACES), st.booleans())
def test_the_gradient_of_the_own_range_is_its_finite_difference(seed, space, aged):
    state, position, age = scene(seed, space)
    age = age if aged else np.zeros_like(age)
    distance, rows = own_range(space, state, position, age)
    np.testing.assert_array_equal(rows.shape, state.shape)
    for component in range(state.shape[1]):
        step = np.zeros(state.shape[1])
        step[component] = 1e-5
        above, _ = own_range(space, state + step, position, age)
        below, _ = own_range(space, state - step, position, age)
        error = np.abs((above - below) / 2e-5 - rows[:, component])
        # The third derivative grows as the agent comes nearer.
        assert (error < 1e-8 + 1e-9 / distance**2).all()


@settings(deadline=None)
@given(SEEDS, st.sampled_from(SPACES))
def test_the_own_range_is_the_distance_to_where_the_target_was_when_it_sent(seed, space):
    state, position, age = scene(seed, space)
    axes = space.axes
    distance, _ = own_range(space, state, position, age)
    for row in range(len(state)):
        then = list(state[row, :axes] - age[row] * state[row, axes:])
        then += [space.height] if axes == 2 else []
        expected = sum((a - b) ** 2 for a, b in zip(then, position[row], strict=True)) ** 0.5
        assert distance[row] == pytest.approx(expected, rel=1e-12)


def test_a_target_at_the_agent_has_no_direction():
    distance, rows = own_range(Space(), np.ones((1, 6)), np.ones((1, 3)), np.zeros(1))
    assert distance.tolist() == [0.0]
    assert rows.tolist() == [[0.0] * 6]


def measured(seed, space, *, agents=4, neighbours=3):
    random = np.random.default_rng(seed)
    target = random.normal(scale=5.0, size=3)
    if space.height is not None:
        target[2] = space.height
    own, other = (
        random.normal(scale=5.0, size=(agents, 3)),
        random.normal(scale=5.0, size=(agents, neighbours, 3)),
    )
    return target, Measurement(
        own,
        np.linalg.norm(own - target, axis=1),
        np.zeros(agents),
        other,
        np.linalg.norm(other - target, axis=2),
    )


@settings(deadline=None)
@given(SEEDS, st.sampled_from(SPACES))
def test_differenced_rows_are_exact_for_ranges_without_noise(seed, space):
    target, measurement = measured(seed, space)
    rows, right, present = differenced_rows(space, measurement)
    assert present.all()
    assert rows.shape == (4, 3, space.axes)
    np.testing.assert_allclose(rows @ target[: space.axes], right, rtol=0, atol=1e-11)


def test_a_row_needs_both_of_its_ranges():
    _, measurement = measured(3, Space())
    measurement.range[1] = np.nan
    measurement.neighbour_range[2, 0] = np.nan
    rows, right, present = differenced_rows(Space(), measurement)
    expected = np.ones((4, 3), dtype=bool)
    expected[1], expected[2, 0] = False, False
    np.testing.assert_array_equal(present, expected)
    assert (rows[~present] == 0.0).all()
    assert (right[~present] == 0.0).all()
    assert np.isfinite(right).all()


def test_embedding_puts_a_plane_into_space_with_no_doubt_of_its_height():
    space = Space(2.5)
    state = np.array([[1.0, 2.0, 3.0, 4.0]])
    covariance = np.arange(16.0).reshape(1, 4, 4)
    assert space.embed_state(state).tolist() == [[1.0, 2.0, 2.5, 3.0, 4.0, 0.0]]
    embedded = space.embed_covariance(covariance)[0]
    np.testing.assert_array_equal(embedded[np.ix_(space.kept, space.kept)], covariance[0])
    assert (embedded[[2, 5]] == 0.0).all()
    assert (embedded[:, [2, 5]] == 0.0).all()
    # Models of the motion may have an acceleration, too, which begins a belief without.
    longer = np.pad(covariance, ((0, 0), (0, 2), (0, 2)), constant_values=9.0)
    np.testing.assert_array_equal(space.embed_covariance(longer)[0], embedded)
    full = np.ones((1, 6))
    assert Space().embed_state(full) is full
