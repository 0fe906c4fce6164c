"""Derivatives of a turn, on both sides of the angle below which a series stands for the closed form."""

import numpy as np
import pytest

from zenoh_cbef.tracking.motion.turn import _STRAIGHT, CoordinatedTurn


@pytest.mark.parametrize("share", [-0.99, -0.5, 0.1, 0.5, 0.99, 1.01, 2.0])
def test_series_and_closed_form_are_the_same_function(share: float) -> None:
    dt, fast = 0.5, 1e6
    angle = share * _STRAIGHT
    found = CoordinatedTurn(dt, 0.1).jacobian(np.array([[0.0, 0.0, 0.0, fast, 0.0, 0.0, angle / dt]]))[0, :2, -1]
    # The way along the first direction is dt sin(a)/a, aside dt (1 - cos(a))/a, of half angles where that keeps digits.
    half = angle / 2.0
    aside = np.sin(half) ** 2 / (2.0 * half**2)
    along = (np.cos(angle) - np.sin(angle) / angle) / angle
    expected = dt**2 * fast * np.array([along, np.cos(half) * np.sin(half) / half - aside])
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-3)
