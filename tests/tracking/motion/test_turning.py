"""A target that turns keeps its speed while ranges correct its heading."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.tracking.motion import NearlyConstantVelocity, turned
from zenoh_cbef.tracking.motion.turn import CoordinatedTurn

TURN = CoordinatedTurn(1.0, 2e-4, 2, 1.0, 0.01, keeps_speed=True)
SPREAD = np.diag([0.1, 0.1, 0.05, 0.2, 0.01])[None] ** 2
BEFORE = np.array([[0.0, 0.0, 4.0, 0.0, 0.5]])


def test_a_correction_aside_turns_the_velocity_and_what_is_known_of_it():
    moved = BEFORE + np.array([0.1, 0.2, 0.03, 0.3, 0.0])
    state, covariance = turned(TURN, (BEFORE, SPREAD), (moved, SPREAD))
    angle = np.arctan2(0.3, 4.03)
    np.testing.assert_allclose(state[0, 2:4], 4.03 * np.array([np.cos(angle), np.sin(angle)]))
    np.testing.assert_array_equal(state[0, [0, 1, 4]], moved[0, [0, 1, 4]])
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    known = covariance[0, 2:4, 2:4]
    np.testing.assert_allclose(
        [along @ known @ along, across @ known @ across, along @ known @ across], [0.05**2, 0.2**2, 0], atol=1e-15
    )


@pytest.mark.parametrize(
    ("motion", "before"),
    [
        (NearlyConstantVelocity(1.0, 0.1, 2), BEFORE[:, :4]),
        (CoordinatedTurn(1.0, 2e-4, 2, 1.0, 0.01), BEFORE),
        (TURN, BEFORE * np.array([1, 1, 0.05, 1, 1])),
    ],
    ids=["a straight motion", "older rules", "a heading that is not known"],
)
def test_what_ranges_tell_moves_the_velocity_otherwise(motion, before):
    size = before.shape[1]
    after = before + 0.1, SPREAD[:, :size, :size]
    state, covariance = turned(motion, (before, SPREAD[:, :size, :size]), after)
    np.testing.assert_array_equal(state, after[0])
    np.testing.assert_array_equal(covariance, after[1])


@pytest.mark.parametrize(("keeps", "honest"), [(True, True), (False, False)])
def test_the_speed_on_a_circle_is_as_well_known_as_claimed(keeps, honest):
    # Places of a target that goes round in eight steps, as well known as ranges of six agents tell them.
    motion, radius, rate, std = CoordinatedTurn(1.0, 2e-4, 2, 1.0, 0.01, keeps_speed=keeps), 5.0, np.pi / 4, 0.06
    random, runs = np.random.default_rng(1), 20
    state = np.repeat([[radius, 0.0, 0.0, radius * rate, rate]], runs, axis=0)
    covariance = np.repeat(np.diag([0.1, 0.1, 0.3, 0.3, 0.1])[None] ** 2, runs, axis=0)
    off, claimed = [], []
    for step in range(1, 121):
        before = motion.predict_state(state), motion.predict_covariance(covariance, state)
        place = radius * np.array([np.cos(rate * step), np.sin(rate * step)]) + std * random.normal(size=(runs, 2))
        gain = before[1][:, :, :2] @ np.linalg.inv(before[1][:, :2, :2] + std**2 * np.eye(2))
        moved = before[0] + (gain @ (place - before[0][:, :2])[:, :, None])[:, :, 0]
        state, covariance = turned(motion, before, (moved, before[1] - gain @ before[1][:, :2]))
        along = np.array([-np.sin(rate * step), np.cos(rate * step)])
        off.append(np.linalg.norm(state[:, 2:4], axis=1) - radius * rate)
        claimed.append(np.einsum("i,nij,j->n", along, covariance[:, 2:4, 2:4], along))
    ratio = np.mean(np.square(off[60:])) / np.mean(claimed[60:])
    assert (ratio < 1.5) == honest
