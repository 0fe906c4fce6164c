"""Smoothing: what least squares on the whole run gives at once, computed backwards from the filter's estimates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.tracking.backwards import Backward, OneMotion, SeveralMotions
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.motion import MOTIONS, MotionSettings, NearlyConstantVelocity, make_motion
from zenoh_cbef.tracking.ranging import Space
from zenoh_cbef.tracking.smoothing import FixedLag, smoothed
from zenoh_cbef.tracking.switching import Switching

DT, ACCELERATION, STD, STEPS, ROWS = 0.3, 0.7, 0.4, 9, 3
SPACES = [Space(), Space(1.5)]


class Linear:
    """Agents that measure projections of the target's position, some of them missing; a filter, and least squares.

    The unknowns of the least squares are the state before step 1 and every step's acceleration: everything else
    follows from them, so the singular process noise needs no inverse.
    """

    def __init__(self, space: Space, gap: int | None = None) -> None:
        random = np.random.default_rng(8)
        self.space, self.size = space, 2 * space.axes
        self.motion = NearlyConstantVelocity(DT, ACCELERATION, space.axes)
        self.rows = np.zeros((ROWS, STEPS, self.size))
        self.rows[:, :, : space.axes] = random.normal(size=(ROWS, STEPS, space.axes))
        self.values = random.normal(scale=3.0, size=(ROWS, STEPS))
        self.heard = random.random((ROWS, STEPS)) < 0.8
        if gap is not None:
            self.heard[:, gap] = False
        self.prior = random.normal(size=(ROWS, self.size)), np.diag(np.arange(1.0, self.size + 1.0))

    def filtered(self) -> tuple[np.ndarray, np.ndarray]:
        """The Kalman filter's states (n, K, 6) and covariances (n, K, 6, 6)."""
        states, covariances = np.empty((ROWS, STEPS, 6)), np.empty((ROWS, STEPS, 6, 6))
        for row in range(ROWS):
            state, covariance = self.prior[0][row], self.prior[1]
            for step in range(STEPS):
                state = self.motion.transition @ state
                covariance = self.motion.transition @ covariance @ self.motion.transition.T + self.motion.process_noise
                if self.heard[row, step]:
                    seen = self.rows[row, step]
                    gain = covariance @ seen / (seen @ covariance @ seen + STD**2)
                    state = state + gain * (self.values[row, step] - seen @ state)
                    covariance = covariance - np.outer(gain, seen @ covariance)
                states[row, step] = self.space.embed_state(state[None])[0]
                covariances[row, step] = self.space.embed_covariance(covariance[None])[0]
        return states, covariances

    def least_squares(self, last: int = STEPS) -> tuple[np.ndarray, np.ndarray]:
        """States (n, last, s) and covariances from all that was measured up to a step."""
        axes = self.space.axes
        push = np.kron([[0.5 * DT**2], [DT]], np.eye(axes))
        # State k as a linear function of the unknowns.
        maps = np.zeros((last, self.size, self.size + axes * last))
        for step in range(last):
            before = maps[step - 1] if step else np.eye(self.size, maps.shape[2])
            maps[step] = self.motion.transition @ before
            maps[step, :, self.size + axes * step : self.size + axes * (step + 1)] += push
        states, covariances = [], []
        for row in range(ROWS):
            information = np.zeros((maps.shape[2], maps.shape[2]))
            information[: self.size, : self.size] = np.linalg.inv(self.prior[1])
            information[self.size :, self.size :] = np.eye(axes * last) / ACCELERATION**2
            vector = information[:, : self.size] @ self.prior[0][row]
            for step in np.flatnonzero(self.heard[row, :last]).tolist():
                seen = self.rows[row, step] @ maps[step]
                information += np.outer(seen, seen) / STD**2
                vector += seen * self.values[row, step] / STD**2
            covariance = np.linalg.inv(information)
            states.append(maps @ (covariance @ vector))
            covariances.append(maps @ covariance @ maps.swapaxes(1, 2))
        return np.array(states), np.array(covariances)


def part(space: Space, covariances: np.ndarray) -> np.ndarray:
    return covariances[..., space.kept[:, None], space.kept]


@pytest.mark.parametrize("space", SPACES)
def test_the_whole_run_smoothed_is_its_least_squares_solution(space):
    problem = Linear(space)
    states, covariances = smoothed(*problem.filtered(), problem.motion, space)
    expected, uncertain = problem.least_squares()
    np.testing.assert_allclose(states[:, :, space.kept], expected, rtol=0, atol=1e-10)
    np.testing.assert_allclose(part(space, covariances), uncertain, rtol=0, atol=1e-10)
    if space.height is not None:
        assert (states[:, :, 2] == space.height).all()


def test_what_errors_that_last_add_to_a_covariance_is_no_information():
    problem, excess = Linear(Space()), np.linspace(0.0, 4.0, ROWS * STEPS).reshape(ROWS, STEPS)
    states, covariances = problem.filtered()
    wide = (1.0 + excess)[:, :, None, None]
    how = problem.motion, problem.space
    plain, found = smoothed(states, covariances, *how), smoothed(states, covariances * wide, *how, excess=excess)
    np.testing.assert_allclose(found[0], plain[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[1], plain[1] * wide, rtol=0, atol=1e-9)


def test_a_fixed_lag_is_the_least_squares_solution_of_what_was_known_then():
    problem, lag = Linear(Space()), 3
    found, uncertain = smoothed(*problem.filtered(), problem.motion, problem.space, lag)
    for step in range(STEPS):
        expected, covariances = problem.least_squares(min(step + lag + 1, STEPS))
        np.testing.assert_allclose(found[:, step], expected[:, step], rtol=0, atol=1e-10)
        np.testing.assert_allclose(uncertain[:, step], covariances[:, step], rtol=0, atol=1e-10)


def test_a_step_without_an_estimate_is_bridged_as_one_without_a_range():
    problem = Linear(Space(), gap=4)
    states, covariances = problem.filtered()
    whole = smoothed(states, covariances, problem.motion, problem.space)
    states[1, 4], covariances[1, 4] = np.nan, np.nan
    for found, expected in zip(smoothed(states, covariances, problem.motion, problem.space), whole, strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_before_the_first_and_after_the_last_estimate_there_is_nothing():
    problem = Linear(Space())
    states, covariances = problem.filtered()
    states[0, :3] = states[1, -2:] = states[2] = np.nan
    for lag in (None, 2):
        found, uncertain = smoothed(states, covariances, problem.motion, problem.space, lag)
        known = np.isfinite(found).all(axis=2)
        assert known.tolist() == np.isfinite(states).all(axis=2).tolist()
        assert (np.isfinite(uncertain).all(axis=(2, 3)) == known).all()


def test_an_agent_alone_has_the_bits_that_it_has_in_a_batch():
    problem = Linear(Space())
    states, covariances = problem.filtered()
    together = smoothed(states, covariances, problem.motion, problem.space, 4)
    for row in range(ROWS):
        alone = smoothed(states[[row]], covariances[[row]], problem.motion, problem.space, 4)
        for one, all_of_them in zip(alone, together, strict=True):
            assert one[0].tobytes() == all_of_them[row].tobytes()


def test_an_agent_that_begins_anew_says_nothing_of_what_was_before():
    problem = Linear(Space())
    states, covariances = problem.filtered()
    window = FixedLag(OneMotion(problem.motion), problem.space, 2)
    for step in range(1, 5):
        window.take(step, Belief(states[:, step - 1], covariances[:, step - 1]), np.array([False, step == 3, False]))
        told = [(one.step, one.until, one.known.tolist()) for one in window.due()]
        assert told == ([(step - 2, step, [True, False, True])] if step > 2 else [])
    assert [(one.step, bool(one.known.all())) for one in window.rest()] == [(3, True), (4, True)]


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_whatever_the_filter_did_the_result_is_a_covariance(seed, before, after):
    """As where a network widens its covariance, or gets a fix, between two steps."""
    random = np.random.default_rng(seed)
    motion = NearlyConstantVelocity(0.1, 1.0)
    first, second = (
        scale * factor @ factor.swapaxes(1, 2)
        for scale, factor in zip((before, after), random.normal(size=(2, 4, 6, 7)), strict=True)
    )
    backward = Backward.of(Belief(random.normal(size=(4, 6)), first), motion)
    _, carried = backward.carried(random.normal(size=(4, 6)), second)
    assert np.array_equal(carried, carried.swapaxes(1, 2))
    assert (np.linalg.eigvalsh(carried) >= -1e-9 * np.linalg.eigvalsh(carried)[:, -1:]).all()
    # A later step of which no more is known than was predicted says nothing of the one before.
    predicted = motion.predict_covariance(first)
    _, carried = backward.carried(random.normal(size=(4, 6)), predicted)
    np.testing.assert_allclose(carried, first, rtol=0, atol=1e-8 * np.abs(first).max())


@pytest.mark.parametrize("kind", MOTIONS)
@pytest.mark.parametrize("space", SPACES)
def test_the_backward_step_of_any_motion_is_the_regression_on_sampled_next_states(kind, space):
    motion = make_motion(kind, MotionSettings(dt=0.1, acceleration_std=2.0, axes=space.axes, turn_rate_std=0.5))
    random, size = np.random.default_rng(3), motion.size
    root = 0.1 * random.normal(size=(size, size))
    state = random.normal(size=size)
    backward = Backward.of(Belief(state[None], (root @ root.T)[None]), motion)
    before = state + random.normal(size=(40_000, size)) @ root.T
    noise = random.multivariate_normal(np.zeros(size), motion.process_noise, size=len(before), method="svd")
    after = motion.predict_state(before) + noise
    told = backward.offset + after @ backward.gain[0].T
    # What is left is small beside the covariance before, and alike in every direction that it has.
    left = np.cov((before - told).T)
    np.testing.assert_allclose(left, backward.rest[0], rtol=0, atol=0.03 * np.abs(root @ root.T).max())
    np.testing.assert_allclose((before - told).mean(axis=0), 0.0, atol=0.02)


SWITCHING = Switching(
    tuple(make_motion(kind, MotionSettings(0.4, 0.8, turn_rate_std=0.4)) for kind in ("ncv", "turn", "stationary")),
    (0.3,),
)


def chain(before, after, count):
    """By which model the target moves in the step after a step's, for sampled models of that step: Bayes's rule."""
    random = np.random.default_rng(12)
    turned = np.full((3, 3), 0.15) + 0.55 * np.eye(3)
    joint = before[:, None] * turned  # How likely each pair is, before the later step's ranges.
    joint *= after / joint.sum(axis=0)
    return np.divmod(random.choice(9, count, p=joint.ravel()), 3)


@pytest.mark.slow
def test_two_steps_of_several_motions_have_the_moments_of_sampled_paths():
    random, count = np.random.default_rng(11), 300_000
    before, after = np.array([0.5, 0.3, 0.2]), np.array([0.2, 0.6, 0.2])
    beliefs = []
    for motion in SWITCHING.motions:
        root = 0.3 * random.normal(size=(motion.size, motion.size)) / np.sqrt(motion.size)
        beliefs.append((0.5 * random.normal(size=(1, motion.size)), (root @ root.T)[None]))
    mean, spread = SWITCHING.pairs(before[None], after[None], beliefs)
    first, then = chain(before, after, count)
    paths = np.zeros((count, 12))
    for i in range(3):
        state, covariance = (one[0] for one in beliefs[i])
        for j, motion in enumerate(SWITCHING.motions):
            rows = (first == i) & (then == j)
            drawn = random.multivariate_normal(state, covariance, size=rows.sum(), method="svd")
            if motion.size > 6 and len(state) == 6:
                drawn = np.column_stack([drawn, 0.4 * random.normal(size=len(drawn))])
            drawn = drawn[:, : motion.size]
            # What `pairs` linearises is linear here.
            at = np.pad(state, (0, 7 - len(state)))[None, : motion.size]
            moved = motion.predict_state(at) + (drawn - at) @ motion.jacobian(at).reshape(motion.size, -1).T
            noise = random.multivariate_normal(np.zeros(motion.size), motion.process_noise, len(drawn), method="svd")
            paths[rows] = np.column_stack([drawn[:, :6], (moved + noise)[:, :6]])
    np.testing.assert_allclose(mean[0], paths.mean(axis=0), atol=0.006)
    np.testing.assert_allclose(spread[0], np.cov(paths.T), atol=0.006)
    way = Backward.within((mean, spread))
    np.testing.assert_allclose(way.gain[0], np.linalg.lstsq(
        np.cov(paths.T)[6:, 6:], np.cov(paths.T)[6:, :6], rcond=None)[0].T, atol=0.1)  # fmt: skip


def test_several_motions_are_smoothed_by_what_the_filter_keeps_of_each_wherever_that_stands():
    random, beliefs = np.random.default_rng(4), []
    for motion in SWITCHING.motions:
        root = random.normal(size=(2, motion.size, motion.size))
        beliefs.append(Belief(random.normal(size=(2, motion.size)), root @ root.swapaxes(1, 2)))
    chance = np.array([[0.2, 0.5, 0.3], [0.6, 0.3, 0.1]])
    mixture = SWITCHING.combined(chance, [(one.state, one.known_covariance) for one in beliefs])
    inner = Belief(*mixture, chance=chance, parts=tuple(beliefs))
    ways = SeveralMotions(SWITCHING)
    assert ways.kept(inner) is inner
    assert ways.kept(Belief(*mixture, memory=(np.ones(2),), parts=(Belief(*mixture), inner))) is inner
    # During a first fix there is one belief for all models, and all are alike.
    alike = ways.kept(Belief(*mixture))
    assert (alike.state is mixture[0], alike.covariance is mixture[1]) == (True, True)
    np.testing.assert_array_equal(alike.known_chance, 1.0 / 3.0)
    assert [one.state.shape[1] for one in alike.parts] == [6, 7, 6]
    later = Belief(*mixture, chance=chance[:, ::-1], parts=tuple(beliefs))
    way = ways.between(inner, later)
    expected = Backward.within(
        SWITCHING.pairs(chance, chance[:, ::-1], [(one.state, one.known_covariance) for one in beliefs])
    )
    np.testing.assert_array_equal(way.offset, expected.offset)
    np.testing.assert_array_equal(way.rest, expected.rest)


def test_the_way_back_within_a_joint_distribution_is_the_conditional_one():
    root = np.random.default_rng(2).normal(size=(3, 8, 8))
    spread, mean = root @ root.swapaxes(1, 2), np.random.default_rng(3).normal(size=(3, 8))
    way = Backward.within((mean, spread))
    information = np.linalg.inv(spread)  # Given the second half, the first has the inverse of its block.
    np.testing.assert_allclose(way.rest, np.linalg.inv(information[:, :4, :4]), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(way.gain, -way.rest @ information[:, :4, 4:], rtol=1e-6, atol=1e-7)
    told, uncertain = way.carried(mean[:, 4:], spread[:, 4:, 4:])
    np.testing.assert_allclose(told, mean[:, :4], atol=1e-9)
    np.testing.assert_allclose(uncertain, spread[:, :4, :4], rtol=1e-7, atol=1e-9)
