"""The nearly-constant-velocity model is the paper's."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.tracking.motion import NearlyConstantVelocity


def test_the_matrices_are_those_of_the_paper():
    dt, std = 0.2, 3.0
    motion = NearlyConstantVelocity(dt, std)
    zero, eye = np.zeros((3, 3)), np.eye(3)
    gain = np.vstack([dt**2 / 2 * eye, dt * eye])
    np.testing.assert_array_equal(motion.transition, np.block([[eye, dt * eye], [zero, eye]]))
    np.testing.assert_allclose(motion.process_noise, std**2 * gain @ gain.T, rtol=1e-14)
    assert motion.size == 6


def test_a_plane_has_the_same_model_along_two_axes():
    full, plane = NearlyConstantVelocity(0.2, 3.0), NearlyConstantVelocity(0.2, 3.0, axes=2)
    kept = np.ix_([0, 1, 3, 4], [0, 1, 3, 4])
    np.testing.assert_array_equal(plane.transition, full.transition[kept])
    np.testing.assert_allclose(plane.process_noise, full.process_noise[kept], rtol=1e-14)
    assert plane.size == 4


@pytest.mark.parametrize("axes", [2, 3])
def test_prediction_moves_every_row(axes):
    motion = NearlyConstantVelocity(0.5, 0.7, axes)
    random = np.random.default_rng(2)
    state = random.normal(size=(4, 2 * axes))
    root = random.normal(size=(4, 2 * axes, 2 * axes))
    covariance = root @ np.swapaxes(root, 1, 2)
    predicted = motion.predict_state(state)
    np.testing.assert_allclose(predicted[:, :axes], state[:, :axes] + 0.5 * state[:, axes:], rtol=1e-14)
    np.testing.assert_array_equal(predicted[:, axes:], state[:, axes:])
    expected = [motion.transition @ one @ motion.transition.T + motion.process_noise for one in covariance]
    np.testing.assert_allclose(motion.predict_covariance(covariance), expected, rtol=1e-12)
