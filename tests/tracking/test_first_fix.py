"""The first fix against equations that are written down here once more, with derivatives taken numerically."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.finding.first_fix import FirstFix
from zenoh_cbef.tracking.filters.finding.squared_ranges import Frame, Seen, SquaredRanges
from zenoh_cbef.tracking.filters.information_form import packed_size
from zenoh_cbef.tracking.filters.kinds.icf import InformationWeighted
from zenoh_cbef.tracking.linalg import unpack_upper
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours

MIDDLE, UNIT, SPEED, VARIANCE = np.array([2.0, -1.0, 3.0]), 20.0, 1.5, 0.09
POINT, AGENT, AGE, RANGE = np.array([9.0, 4.0, -5.0]), np.array([6.0, -8.0, 1.0]), 0.8, 19.0
COVARIANCE = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, -2.0], [0.0, -2.0, 1.0]])


def slopes(function, at, step=1e-4):
    """Derivatives of a function of a vector, by central differences."""
    return np.array([(function(at + one) - function(at - one)) / (2.0 * step) for one in step * np.eye(len(at))])


def squared(place, velocity, error):
    """The squared range that an agent measures of a beacon that is AGE old, in squares of the unit."""
    return (np.linalg.norm(place - AGE * velocity - AGENT) + error) ** 2 / UNIT**2


def shared(*, xi=np.inf, agent=AGENT, speed=SPEED, range_=RANGE, variance=VARIANCE, space=None, rate=True):
    """What one agent of four shares of one range: information vector and matrix of (q, |q|^2, d|q|^2/dt).

    Without rate: of (q, |q|^2).
    """
    space = space or Space()
    axes = space.axes
    payload = SquaredRanges(space, 4, xi, rate).payload(
        Frame(MIDDLE[None, :axes], np.array([UNIT])),
        Belief(POINT[None, :axes], COVARIANCE[None, :axes, :axes]),
        Seen(agent[None, None], np.array([[AGE]]), np.array([[range_]])),
        variance=np.array([[variance]]),
        speed=np.array([speed]),
    )[0]
    size = axes + 1 + rate
    prior = np.diag([1.0] * axes + [100.0**-2] * (1 + rate)) / 4
    return payload[:size], unpack_upper(payload[None, size:], size)[0] - prior


@pytest.mark.parametrize("space", [Space(), Space(2.5)])
def test_without_noise_the_rows_hold_for_the_true_position_and_its_square(space):
    axes = space.axes
    place = np.append(POINT[:2], POINT[2] if axes == 3 else 2.5)
    at = np.array([[6.0, -8.0, 1.0], [0.0, 3.0, 4.0], [-7.0, 2.0, 9.0]])
    # The velocity is at right angles to where the agents stand: what is left then is |v|^2 t^2, added here.
    away = np.zeros(3)
    for agent in at:
        away[:axes] = np.linalg.svd((agent - MIDDLE)[None, :axes])[2][-1]
        velocity = 1.5 * away
        far = np.linalg.norm(place - AGE * velocity - agent)
        range_ = np.sqrt(far**2 - np.sum((AGE * velocity) ** 2))
        vector, matrix = shared(agent=agent, range_=range_, space=space)
        q = (place - MIDDLE)[:axes] / UNIT
        change = 2.0 * q @ velocity[:axes] / UNIT
        np.testing.assert_allclose(vector, matrix @ np.array([*q, q @ q, change]), rtol=1e-9, atol=1e-9)


def test_a_rows_noise_is_that_of_the_range_and_of_the_motion_that_the_row_leaves_out():
    _, matrix = shared()
    at = (AGENT - MIDDLE) / UNIT
    # Of the range's error: first and second order, as var(e^2) = 2 sigma^4. The row is linear in all but a^T v.
    by_error = 2.0 * RANGE / UNIT**2
    by_motion = slopes(lambda v: np.sum((AGE * v / UNIT + at) ** 2) - np.sum((AGE * v / UNIT) ** 2), np.zeros(3))
    moved = SPEED * AGE / UNIT
    noise = by_error**2 * VARIANCE + 2.0 * (VARIANCE / UNIT**2) ** 2 + SPEED**2 * by_motion @ by_motion + moved**4
    assert 1.0 / matrix[3, 3] == pytest.approx(noise, rel=1e-9)
    row = np.array([*(-2.0 * at), 1.0, -AGE])
    np.testing.assert_allclose(matrix, np.outer(row, row) / noise, rtol=1e-9)


def test_without_an_unknown_for_it_the_target_s_receding_is_noise_of_the_row():
    (_, known), (_, noisy) = shared(), shared(rate=False)
    receding = (2.0 * RANGE * SPEED * AGE / UNIT**2) ** 2
    row = np.array([*(-2.0 * (AGENT - MIDDLE) / UNIT), 1.0])
    np.testing.assert_allclose(noisy, np.outer(row, row) / (1.0 / known[3, 3] + receding), rtol=1e-9)


def test_noise_far_beyond_the_range_counts_by_its_square_and_fast_motion_by_its_fourth_power():
    _, loud = shared(agent=MIDDLE, range_=0.0, speed=0.0, variance=50.0)
    assert 1.0 / loud[3, 3] == pytest.approx(2.0 * 50.0**2 / UNIT**4)
    _, fast = shared(agent=MIDDLE, range_=0.0, speed=80.0, variance=0.0)
    assert 1.0 / fast[3, 3] == pytest.approx((80.0 * AGE / UNIT) ** 4)


def test_a_residual_is_saturated_at_what_noise_motion_and_the_latest_fix_let_expect():
    xi = 0.2
    _, free = shared()
    _, held = shared(xi=xi)
    residual = squared(POINT, np.zeros(3), 0.0) - RANGE**2 / UNIT**2
    by_place = slopes(lambda place: squared(place, np.zeros(3), 0.0), POINT)
    # The range's slope by the velocity, where the squared range is RANGE^2 and the target's direction any.
    by_motion = 2.0 * RANGE / UNIT**2 * AGE * SPEED
    spread = np.sqrt(1.0 / free[3, 3] + by_motion**2 + by_place @ COVARIANCE @ by_place)
    assert abs(residual) > xi * spread
    assert held[3, 3] / free[3, 3] == pytest.approx(xi * spread / abs(residual), rel=1e-6)


def test_a_solution_is_in_metres_around_the_middle_and_n_agents_are_no_surer_than_n():
    q, matrix = np.array([0.3, -0.2, 0.5]), np.diag([3.0, 5.0, 7.0, 11.0, 13.0])
    vector = matrix @ np.array([*q, q @ q, 0.1])
    payload = np.concatenate([vector, matrix[np.triu_indices(5)]])[None]
    fix = SquaredRanges(Space(), 4, np.inf).solve(payload, payload, Frame(MIDDLE[None], np.array([UNIT])))
    np.testing.assert_allclose(fix.state, [MIDDLE + UNIT * q])
    np.testing.assert_allclose(fix.known_covariance, [UNIT**2 * np.diag([1 / 3, 1 / 5, 1 / 7]) / 4])


def test_an_unknown_square_is_that_of_the_unknown_position():
    """Joined, moments of a position and its square that are told to be independent are those of a Gaussian update."""
    q, spread, square, variance = np.array([0.3, -0.2, 0.5]), np.diag([0.04, 0.01, 0.09]) / 4, 0.6, 0.02 / 4
    matrix = np.diag([*1.0 / (4 * np.diag(spread)), 1.0 / (4 * variance)])
    payload = np.concatenate([matrix @ np.array([*q, square]), matrix[np.triu_indices(4)]])[None]
    squared = SquaredRanges(Space(), 4, np.inf, rate=False)
    fix = squared.solve(payload, payload, Frame(MIDDLE[None], np.array([UNIT])), joined=True)
    # |q|^2 of q ~ N(m, C) has the mean |m|^2 + tr C, covariance 2 C m with q, and the variance 4 m^T C m + 2 tr C^2.
    cross = 2.0 * spread @ q
    total = 4.0 * q @ spread @ q + 2.0 * np.trace(spread @ spread) + variance
    expected = q + cross / total * (square - q @ q - np.trace(spread))
    np.testing.assert_allclose(fix.state[0], MIDDLE + UNIT * expected)
    np.testing.assert_allclose(fix.known_covariance[0], UNIT**2 * (spread - np.outer(cross, cross) / total))


def old_range(state, agent, age):
    return np.linalg.norm(state[:3] - age * state[3:] - agent)


def way(q, dt, ages, steps=2000):
    """Covariance (k, k) of how far a target is off its straight line, by a sum over short steps of its acceleration."""
    instants = (np.arange(steps) + 0.5) * max(ages) / steps
    lever = np.maximum(np.array(ages)[:, None] - instants, 0.0)
    return q**2 * dt * max(ages) / steps * lever @ lever.T


@pytest.mark.parametrize("guesses", [(1, 1), None])
@pytest.mark.parametrize(("bias", "xi"), [(0.0, np.inf), (0.3, np.inf), (0.0, 0.2)])
def test_the_second_half_is_gauss_newton_on_all_ranges_and_older_ones_count_less(bias, xi, guesses):
    dt, acceleration, std, steps = 0.5, 2.0, 0.1, 6
    motion, space = NearlyConstantVelocity(dt, acceleration), Space()
    then = InformationWeighted(motion, space, std, 1)
    filter_ = FirstFix(then, motion, space, std, bias, 1, steps, packed_size(6), xi, guesses=guesses)
    agents = np.random.default_rng(5).uniform(-10.0, 10.0, (steps, 3))
    ages = np.array([0.0, 0.1, 0.05, 0.2, 0.0, 0.1])
    ranges = 6.0 + np.arange(steps) * np.array([1.0, -1.0, 0.5, np.nan, 1.0, -0.5])
    mean, covariance = np.array([1.0, 2.0, 0.5, 0.3, -0.2, 0.1]), np.diag([25.0] * 3 + [1.0] * 3)
    belief, transition = Belief(mean[None], covariance[None]), np.kron([[1.0, dt], [0.0, 1.0]], np.eye(3))
    correction = np.zeros(6)
    for k in range(steps):
        mean, covariance = transition @ mean, transition @ covariance @ transition.T + motion.process_noise
        state = transition @ belief.state[0]
        known = transition @ belief.known_covariance[0] @ transition.T + motion.process_noise
        own = Measurement(agents[[k]], ranges[[k]], ages[[k]], *no_neighbours(1))
        update = filter_.update(belief, own)
        belief = filter_.conclude(update.payload, update)
        measured = np.flatnonzero(np.isfinite(ranges[: k + 1])).tolist()
        matrix, residuals = np.linalg.inv(covariance), np.zeros(6)
        old = [ages[j] + (k - j) * dt for j in range(k + 1)]
        wandered = way(acceleration, dt, old) if guesses else np.diag((0.5 * acceleration * np.array(old) ** 2) ** 2)
        rows, equivalents, noise = [], [], []
        for j in measured:
            row = slopes(partial(old_range, agent=agents[j], age=old[j]), state)
            alone = std**2 + len(measured) * bias**2
            variance = alone + wandered[j, j]
            innovation = ranges[j] - old_range(state, agents[j], old[j])
            spread = np.sqrt(row @ known @ row + variance + (row @ correction) ** 2)
            weight = min(1.0, xi * spread / abs(innovation))
            rows.append(row)
            equivalents.append(innovation + row @ state)
            noise.append((alone if guesses else variance) / weight)
            if j == k:
                assert update.diagnostics.weight[0] == pytest.approx(weight, rel=1e-6)
                assert update.diagnostics.nis[0] == pytest.approx((innovation / spread) ** 2, rel=1e-6)
        # Squared ranges have five unknowns; what is left of a message has the velocity, by earlier rules nothing.
        assert update.payload[0, 23 if guesses else 20 :].any() == (k + 1 > steps // 2)
        if k + 1 > steps // 2:
            total = np.diag(noise)
            if guesses:
                places = np.array(rows)[:, :3]
                total += places @ places.T * wandered[np.ix_(measured, measured)]
            gain = np.array(rows).T @ np.linalg.inv(total)
            matrix, residuals = matrix + gain @ np.array(rows), gain @ np.array(equivalents)
            expected = np.linalg.solve(matrix, np.linalg.inv(covariance) @ mean + residuals)
            np.testing.assert_allclose(belief.state[0], expected, rtol=1e-5, atol=1e-6)
            np.testing.assert_allclose(belief.known_covariance[0], np.linalg.inv(matrix), rtol=1e-5, atol=1e-6)
        correction = belief.state[0] - state
        assert bool(belief.parts) is (k + 1 == steps)
