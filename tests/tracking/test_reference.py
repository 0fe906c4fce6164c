"""The yardsticks: the centralised filter is a textbook one, the bound is that of the whole trajectory."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.tracking.filters import Belief, FilterSettings
from zenoh_cbef.tracking.joint import joint_centralized
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Space
from zenoh_cbef.tracking.reference import centralized_beliefs, each_step, posterior_bound, stacked

DT, ACCELERATION, STD = 0.3, 0.4, 0.2
SPACES = [Space(), Space(-0.4)]


class Scene:
    """Runs with moving agents, aged and missing ranges."""

    def __init__(self, space, runs=3, agents=5, steps=7):
        random = np.random.default_rng(4)
        self.space = space
        self.motion = NearlyConstantVelocity(DT, ACCELERATION, space.axes)
        self.truth = np.cumsum(random.normal(scale=0.3, size=(runs, steps, 6)), axis=1)
        if space.height is not None:
            self.truth[:, :, 2], self.truth[:, :, 5] = space.height, 0.0
        self.positions = random.normal(scale=6.0, size=(runs, agents, steps, 3))
        self.age = random.uniform(0.0, DT, (runs, agents, steps))
        then = self.truth[:, None, :, :3] - self.age[..., None] * self.truth[:, None, :, 3:]
        self.ranges = np.linalg.norm(then - self.positions, axis=3) + STD * random.normal(size=self.age.shape)
        self.ranges[random.random(self.age.shape) < 0.25] = np.nan
        self.age[np.isnan(self.ranges)] = np.nan
        size = 2 * space.axes
        self.initial = Belief(
            self.truth[:, 0, space.kept] + 0.3, np.tile(np.diag(np.arange(1.0, size + 1)), (runs, 1, 1))
        )

    def row(self, run, agent, step, state):
        """Range and gradient at a full state (6,), by the chain rule in three dimensions."""
        age = self.age[run, agent, step]
        offset = state[:3] - age * state[3:] - self.positions[run, agent, step]
        distance = np.linalg.norm(offset)
        return distance, np.concatenate([offset, -age * offset])[self.space.kept] / distance

    def heard(self, run, step):
        return np.flatnonzero(np.isfinite(self.ranges[run, :, step]))

    def full(self, state):
        if self.space.height is None:
            return state
        return np.array([state[0], state[1], self.space.height, state[2], state[3], 0.0])


def textbook(scene, run, xi):
    """An extended Kalman filter in covariance form; saturation divides a range's precision by its excess."""
    state, covariance = scene.initial.state[run], scene.initial.known_covariance[run]
    for step in range(scene.truth.shape[1]):
        state = scene.motion.transition @ state
        covariance = scene.motion.transition @ covariance @ scene.motion.transition.T + scene.motion.process_noise
        heard = scene.heard(run, step)
        described = [scene.row(run, agent, step, scene.full(state)) for agent in heard]
        rows = np.array([row for _, row in described])
        innovation = scene.ranges[run, heard, step] - np.array([predicted for predicted, _ in described])
        spread = np.sqrt(np.array([row @ covariance @ row for row in rows]) + STD**2)
        noise = np.diag(STD**2 * np.maximum(1.0, np.abs(innovation) / (xi * spread)))
        gain = covariance @ rows.T @ np.linalg.inv(rows @ covariance @ rows.T + noise)
        state = state + gain @ innovation
        covariance = covariance - gain @ rows @ covariance
        yield scene.full(state), covariance


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("xi", [0.3, 1.5, np.inf])
def test_the_centralised_filter_is_the_textbook_extended_kalman_filter(space, xi):
    scene = Scene(space)
    steps = each_step(positions=scene.positions, ranges=scene.ranges, age=scene.age, range_std=STD)
    beliefs = centralized_beliefs(scene.initial, scene.motion, space, steps, xi=xi)
    states, covariances = stacked(space, beliefs)
    assert states.shape == (3, 7, 6)
    assert covariances.shape == (3, 7, 6, 6)
    kept = np.ix_(space.kept, space.kept)
    for run in range(3):
        for step, (state, covariance) in enumerate(textbook(scene, run, xi)):
            np.testing.assert_allclose(states[run, step], state, rtol=0, atol=1e-9)
            np.testing.assert_allclose(covariances[run, step][kept], covariance, rtol=0, atol=1e-9)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("xi", [0.3, np.inf])
def test_the_centralised_filter_of_biased_runs_is_the_same_where_there_is_no_bias(space, xi):
    scene = Scene(space)
    chosen = FilterSettings(scene.motion, space, STD, xi, 5)
    states, covariances = joint_centralized(
        scene.initial, chosen, xi, positions=scene.positions, ranges=scene.ranges, age=scene.age
    )
    kept = np.ix_(space.kept, space.kept)
    for run in range(3):
        for step, (state, covariance) in enumerate(textbook(scene, run, xi)):
            np.testing.assert_allclose(states[run, step], state, rtol=0, atol=1e-9)
            np.testing.assert_allclose(covariances[run, step][kept], covariance, rtol=0, atol=1e-9)


def test_the_centralised_filter_with_biases_is_the_kalman_filter_of_position_velocity_and_biases():
    scene, run, (common, own) = Scene(Space()), 1, (0.4, 0.3)
    chosen = FilterSettings(
        scene.motion, Space(), STD, np.inf, 5, bias="estimate", common_bias_std=common, own_bias_std=own
    )
    states, covariances = joint_centralized(
        scene.initial, chosen, np.inf, positions=scene.positions, ranges=scene.ranges, age=scene.age
    )
    mean, covariance, step_by = np.zeros(12), np.zeros((12, 12)), np.eye(12)
    mean[:6], step_by[:6, :6] = scene.initial.state[run], scene.motion.transition
    covariance[:6, :6] = scene.initial.known_covariance[run]
    covariance[6:, 6:] = np.diag([common**2] + [own**2] * 5)
    for step in range(7):
        mean, covariance = step_by @ mean, step_by @ covariance @ step_by.T
        covariance[:6, :6] += scene.motion.process_noise
        heard = scene.heard(run, step)
        # A range widens the variance of its agent's own bias by 0.4 %, up to the prior's.
        spread = covariance[7 + heard, 7 + heard]
        covariance[7 + heard, 7 + heard] = np.minimum(1.004 * spread, np.maximum(spread, own**2))
        described = [scene.row(run, agent, step, mean[:6]) for agent in heard]
        rows = np.array([[*row, 1.0, *np.eye(5)[agent]] for agent, (_, row) in zip(heard, described, strict=True)])
        predicted = np.array([distance for distance, _ in described]) + mean[6] + mean[7 + heard]
        gain = covariance @ rows.T @ np.linalg.inv(rows @ covariance @ rows.T + STD**2 * np.eye(len(heard)))
        mean = mean + gain @ (scene.ranges[run, heard, step] - predicted)
        covariance = covariance - gain @ rows @ covariance
        np.testing.assert_allclose(states[run, step], mean[:6], rtol=0, atol=1e-9)
        np.testing.assert_allclose(covariances[run, step], covariance[:6, :6], rtol=0, atol=1e-9)


def bound_of(scene):
    return posterior_bound(
        scene.initial.covariance,
        scene.motion,
        scene.space,
        truth=scene.truth,
        positions=scene.positions,
        measured=np.isfinite(scene.ranges),
        age=scene.age,
        range_std=STD,
    )


@pytest.mark.parametrize("space", SPACES)
def test_the_bound_is_the_inverse_information_of_the_whole_trajectory(space):
    # The trajectory is linear in its start and all accelerations, whose information is known in one matrix.
    scene, axes = Scene(space), space.axes
    size, bound = 2 * axes, bound_of(scene)
    gain = np.kron([[0.5 * DT**2], [DT]], np.eye(axes))
    for run in range(3):
        maps = []
        last = np.eye(size, size + 7 * axes)
        for step in range(7):
            last = scene.motion.transition @ last
            last[:, size + step * axes : size + (step + 1) * axes] += gain
            maps.append(last)
            information = np.diag(np.full(size + 7 * axes, ACCELERATION**-2.0))
            information[:size, :size] = np.linalg.inv(scene.initial.known_covariance[run])
            for earlier, mapped in enumerate(maps):
                for agent in scene.heard(run, earlier):
                    _, row = scene.row(run, agent, earlier, scene.truth[run, earlier])
                    information += np.outer(row @ mapped, row @ mapped) / STD**2
            expected = last @ np.linalg.inv(information) @ last.T
            np.testing.assert_allclose(bound[run, step][np.ix_(space.kept, space.kept)], expected, rtol=0, atol=1e-9)


def test_the_bound_is_the_kalman_covariance_where_the_rows_are_those_of_the_truth():
    scene = Scene(Space())
    bound, covariance = bound_of(scene), scene.initial.known_covariance[0]
    for step in range(7):
        covariance = scene.motion.transition @ covariance @ scene.motion.transition.T + scene.motion.process_noise
        for agent in scene.heard(0, step):
            _, row = scene.row(0, agent, step, scene.truth[0, step])
            gain = covariance @ row / (row @ covariance @ row + STD**2)
            covariance = covariance - np.outer(gain, row @ covariance)
        np.testing.assert_allclose(bound[0, step], covariance, rtol=0, atol=1e-10)


def test_the_bound_of_a_plane_is_zero_where_the_state_is_known():
    bound = bound_of(Scene(Space(-0.4)))
    assert (bound[:, :, [2, 5]] == 0.0).all()
    assert (bound[:, :, :, [2, 5]] == 0.0).all()


def test_runs_do_not_see_each_other():
    scene = Scene(Space())
    together = bound_of(scene)
    for part in ("truth", "positions", "ranges", "age"):
        setattr(scene, part, getattr(scene, part)[1:2])
    scene.initial = Belief(scene.initial.state[1:2], scene.initial.known_covariance[1:2])
    assert bound_of(scene)[0].tobytes() == together[1].tobytes()
