"""What holds for every model of the target's motion, and what each of them is."""

from __future__ import annotations

from dataclasses import replace
from math import factorial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.tracking.motion import (
    MOTIONS,
    BesideConstants,
    LinearMotion,
    MotionSettings,
    begun,
    constants_of,
    linear,
    make_motion,
)
from zenoh_cbef.tracking.motion.decay import DecayingVelocity, _closed, _series
from zenoh_cbef.tracking.motion.turn import CoordinatedTurn

SETTINGS = MotionSettings(0.3, 0.8, velocity_time=4.0, turn_rate_std=0.7)


def some_beliefs(motion, count=5):
    random = np.random.default_rng(3)
    root = random.normal(size=(count, motion.size, motion.size))
    return random.normal(size=(count, motion.size)), root @ np.swapaxes(root, 1, 2)


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("kind", MOTIONS)
def test_a_row_is_predicted_alike_in_every_batch(kind, axes):
    motion = make_motion(kind, replace(SETTINGS, axes=axes))
    state, covariance = some_beliefs(motion, 11)
    together = motion.predict_state(state), motion.predict_covariance(covariance, state)
    for row in range(11):
        one = state[[row]], covariance[[row]]
        np.testing.assert_array_equal(motion.predict_state(one[0])[0], together[0][row])
        np.testing.assert_array_equal(motion.predict_covariance(one[1], one[0])[0], together[1][row])


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("kind", MOTIONS)
def test_a_state_begins_with_position_and_velocity(kind, axes):
    motion = make_motion(kind, replace(SETTINGS, axes=axes, dt=1e-7))
    known = np.arange(1.0, 2 * axes + 1)[None]
    state, covariance = begun(motion, known, np.eye(2 * axes)[None])
    assert state.shape == (1, motion.size)
    assert covariance.shape == (1, motion.size, motion.size)
    np.testing.assert_array_equal(state[:, : 2 * axes], known)
    np.testing.assert_array_equal(covariance[:, : 2 * axes, : 2 * axes], np.eye(2 * axes)[None])
    np.testing.assert_array_equal(covariance[0, 2 * axes :, 2 * axes :], motion.extra_covariance)
    moved = motion.predict_state(state)[0, :axes]
    np.testing.assert_allclose(moved, known[0, :axes], atol=1e-5)


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("kind", MOTIONS)
def test_constants_beside_a_motion_stay_and_leave_it_as_it_is(kind, axes):
    moving = make_motion(kind, replace(SETTINGS, axes=axes))
    motion, first = BesideConstants(moving, 3, 0.4), 2 * axes
    state, covariance = some_beliefs(motion, 7)
    # The same state with the constants after all that moves.
    order = [*range(first), *range(first + 3, motion.size), *range(first, first + 3)]
    sorted_ = covariance[:, order][:, :, order]
    inner = state[:, order][:, : moving.size]
    step = np.repeat(np.eye(motion.size)[None], 7, axis=0)
    step[:, : moving.size, : moving.size] = moving.jacobian(inner)
    ahead, spread = motion.predict_state(state), motion.predict_covariance(covariance, state)
    np.testing.assert_array_equal(ahead[:, order][:, : moving.size], moving.predict_state(inner))
    np.testing.assert_array_equal(ahead[:, first : first + 3], state[:, first : first + 3])
    expected = step @ sorted_ @ np.swapaxes(step, 1, 2)
    expected[:, : moving.size, : moving.size] += moving.process_noise
    np.testing.assert_allclose(spread[:, order][:, :, order], expected, rtol=1e-10, atol=1e-10)
    assert np.diagonal(motion.process_noise)[first : first + 3].tolist() == [0.0] * 3
    assert (motion.dt, motion.axes, motion.acceleration_std) == (0.3, axes, moving.acceleration_std)
    assert (constants_of(motion), constants_of(moving)) == (3, 0)


def test_constants_begin_with_their_deviation_and_stay_where_a_state_has_them():
    motion = BesideConstants(CoordinatedTurn(0.1, 0.3, turn_rate_std=0.7), 2, 0.4)
    state, covariance = begun(motion, np.arange(1.0, 7.0)[None], np.eye(6)[None])
    np.testing.assert_array_equal(state[0], [1, 2, 3, 4, 5, 6, 0, 0, 0])
    np.testing.assert_allclose(np.diagonal(covariance[0]), [1] * 6 + [0.16, 0.16, 0.49])
    known = np.arange(1.0, 9.0)[None], np.diag(np.arange(1.0, 9.0))[None]
    state, covariance = begun(motion, *known)
    np.testing.assert_array_equal(state[0], [1, 2, 3, 4, 5, 6, 7, 8, 0])
    np.testing.assert_allclose(np.diagonal(covariance[0]), [1, 2, 3, 4, 5, 6, 7, 8, 0.49])


def test_what_constants_have_in_common_is_a_part_of_each_and_makes_them_alike():
    alike = BesideConstants(CoordinatedTurn(0.1, 0.3, turn_rate_std=0.7), 3, 0.4, common_std=2.0)
    _, covariance = begun(alike, np.zeros((1, 6)), np.eye(6)[None])
    np.testing.assert_allclose(covariance[0, 6:9, 6:9], 0.4**2 * np.eye(3) + 2.0**2 * np.ones((3, 3)))
    np.testing.assert_array_equal(covariance[0, 9], [0, 0, 0, 0, 0, 0, 0, 0, 0, 0.7**2])
    np.testing.assert_array_equal(covariance[0, :6, 6:], np.zeros((6, 4)))


def test_every_model_moves_with_its_velocity_at_first():
    for kind in set(MOTIONS) - {"stationary"}:
        motion = make_motion(kind, replace(SETTINGS, dt=1e-6))
        state = np.zeros((1, motion.size))
        state[0, 3:6] = [1.0, -2.0, 0.5]
        np.testing.assert_allclose(motion.predict_state(state)[0, :3] / 1e-6, [1.0, -2.0, 0.5], rtol=1e-5)


@given(
    kind=st.sampled_from(["decay", "acceleration"]),
    dt=st.floats(1e-3, 30.0),
    time=st.floats(0.5, 100.0),
    axes=st.sampled_from([2, 3]),
)
def test_two_half_steps_are_one_step(kind, dt, time, axes):
    # Noise of the same power: an acceleration that lasts `interval`, however long a step is.
    settings = MotionSettings(dt, 0.8, axes, interval=0.2, velocity_time=time)
    whole = linear(make_motion(kind, settings))
    half = linear(make_motion(kind, replace(settings, dt=0.5 * dt)))
    np.testing.assert_allclose(half.transition @ half.transition, whole.transition, rtol=1e-9, atol=1e-12)
    twice = half.predict_covariance(half.process_noise[None])[0]
    scale = np.sqrt(np.diagonal(whole.process_noise))
    np.testing.assert_allclose(twice / np.outer(scale, scale), whole.process_noise / np.outer(scale, scale), atol=1e-9)


@pytest.mark.parametrize("dt", [1e-4, 0.009, 0.011, 0.5, 40.0])
def test_the_noise_of_a_decaying_velocity_is_its_integral(dt):
    motion = DecayingVelocity(dt, 0.7, 3, time=1.0)
    s = (np.arange(200_000) + 0.5) / 200_000 * dt
    gain = np.stack([1.0 - np.exp(-s), np.exp(-s)])
    expected = 0.7**2 * dt * dt * (gain @ gain.T) / len(s)
    np.testing.assert_allclose(motion.process_noise[::3, ::3], expected, rtol=2e-6)


def test_the_series_of_that_noise_is_taylors_of_the_closed_form():
    step = 0.5
    terms = [(2.0 * (-1.0) ** n - 0.5 * (-2.0) ** n) / factorial(n) * step**n for n in range(3, 8)]
    assert _series(step)[0] == pytest.approx(sum(terms), rel=1e-12)
    assert _series(step)[1:] == pytest.approx(_closed(step)[1:], rel=1e-12)


def test_a_decaying_velocity_is_forgotten_and_its_spread_stays_bounded():
    motion = DecayingVelocity(0.1, 2.0, 3, time=5.0)
    state, covariance = np.array([[0.0, 0, 0, 10.0, 0, 0]]), np.eye(6)[None] * 100.0
    for _ in range(1000):
        state, covariance = motion.predict_state(state), motion.predict_covariance(covariance)
    assert state[0, 0] == pytest.approx(10.0 * 5.0)
    assert abs(state[0, 3]) < 1e-6
    assert covariance[0, 3, 3] == pytest.approx(2.0**2 * 0.1 * 5.0 / 2.0)


def test_a_stationary_target_does_not_go_on():
    motion = linear(make_motion("stationary", SETTINGS))
    state = np.arange(1.0, 7.0)[None]
    np.testing.assert_array_equal(motion.predict_state(state), [[1.0, 2.0, 3.0, 0.0, 0.0, 0.0]])
    for throughout, other in ((False, "jump"), (True, "ncv")):
        one = linear(make_motion("stationary", replace(SETTINGS, throughout=throughout)))
        np.testing.assert_array_equal(one.process_noise, linear(make_motion(other, SETTINGS)).process_noise)


def test_a_jump_has_the_moments_of_jumps_at_any_moment_of_a_step():
    motion, random, count = linear(make_motion("jump", SETTINGS)), np.random.default_rng(5), 400_000
    jump = 0.8 * 0.3 * random.normal(size=(count, 3))
    moved = np.concatenate([(0.3 - random.uniform(0.0, 0.3, (count, 1))) * jump, jump], axis=1)
    scale = np.sqrt(np.diagonal(motion.process_noise))
    np.testing.assert_allclose(np.cov((moved / scale).T), motion.process_noise / np.outer(scale, scale), atol=0.01)


def test_a_constant_acceleration_is_the_parabola():
    motion = make_motion("acceleration", SETTINGS)
    place, speed, push = np.array([1.0, 2, 3]), np.array([4.0, 5, 6]), np.array([-1.0, 0.5, 2])
    moved = motion.predict_state(np.concatenate([place, speed, push])[None])[0]
    np.testing.assert_allclose(moved[:3], place + 0.3 * speed + 0.5 * 0.3**2 * push, rtol=1e-14)
    np.testing.assert_allclose(moved[3:6], speed + 0.3 * push, rtol=1e-14)
    np.testing.assert_array_equal(moved[6:], push)


@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("rate", [0.0, 1e-9, -1e-4, 0.6, -3.0])
def test_a_turn_is_a_circle_that_many_small_steps_go_round(rate, axes):
    motion = CoordinatedTurn(0.4, 0.5, axes, turn_rate_std=0.1)
    speed = np.array([2.0, -1.0, 0.7][:axes])
    moved = motion.predict_state(np.concatenate([np.zeros(axes), speed, [rate]])[None])[0]
    steps = 40_000
    angle = rate * 0.4 * (np.arange(steps) + 0.5) / steps
    now = np.tile(speed, (steps, 1))
    now[:, 0] = np.cos(angle) * speed[0] - np.sin(angle) * speed[1]
    now[:, 1] = np.sin(angle) * speed[0] + np.cos(angle) * speed[1]
    place = 0.4 / steps * now.sum(axis=0)
    np.testing.assert_allclose(moved[:axes], place, rtol=1e-8, atol=1e-12)
    assert np.hypot(*moved[axes : axes + 2]) == pytest.approx(np.hypot(2.0, 1.0), rel=1e-12)
    assert moved[-1] == rate


@pytest.mark.parametrize("rate", [0.0, 1e-5, 2.4e-3, 2.6e-3, 0.6, -3.0])
def test_the_jacobian_of_a_turn_is_its_derivative(rate):
    motion = CoordinatedTurn(0.4, 0.5, 3)
    state = np.array([[1.0, 2.0, 3.0, 2.0, -1.0, 0.7, rate]])
    step = 1e-5
    numeric = [
        (motion.predict_state(state + step * unit) - motion.predict_state(state - step * unit))[0] / (2 * step)
        for unit in np.eye(7)
    ]
    np.testing.assert_allclose(motion.jacobian(state)[0], np.array(numeric).T, atol=1e-8)


def test_a_turn_is_not_linear_and_says_so():
    assert not isinstance(make_motion("turn", SETTINGS), LinearMotion)
    with pytest.raises(ValueError, match="not linear"):
        linear(make_motion("turn", SETTINGS))
