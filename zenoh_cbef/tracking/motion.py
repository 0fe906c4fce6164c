"""The nearly-constant-velocity model of the target."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.tracking.linalg import matvec

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class NearlyConstantVelocity:
    """x(k+1) = A x(k) + B w(k), w ~ N(0, q^2 I), as in Ghods and Doostmohammadian (ICRoM 2024), eq. 1 to 3.

    The state is (position, velocity) along `axes` axes: three, or two where the target moves in a plane.

    dt: sampling time D (s). acceleration_std: q (m/s^2).
    """

    dt: float
    acceleration_std: float
    axes: int = 3

    @property
    def size(self) -> int:
        """Number of state components, twice the number of axes."""
        return 2 * self.axes

    @cached_property
    def transition(self) -> Floats:
        """A, (s, s)."""
        return np.kron(np.array([[1.0, self.dt], [0.0, 1.0]]), np.eye(self.axes))

    @cached_property
    def process_noise(self) -> Floats:
        """Q = q^2 B B^T, (s, s)."""
        gain = np.kron(np.array([[0.5 * self.dt**2], [self.dt]]), np.eye(self.axes))
        return np.asarray(self.acceleration_std**2 * gain @ gain.T)

    def predict_state(self, state: Floats) -> Floats:
        """A x for states (n, s)."""
        return matvec(self.transition, state)

    def predict_covariance(self, covariance: Floats) -> Floats:
        """A P A^T + Q for covariances (n, s, s)."""
        return np.asarray(self.transition @ covariance @ self.transition.T + self.process_noise)
