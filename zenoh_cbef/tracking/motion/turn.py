"""A target that turns about the vertical at a rate that is estimated."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.linalg import matvec
from zenoh_cbef.tracking.motion.base import MotionSettings
from zenoh_cbef.tracking.motion.ncv import NearlyConstantVelocity

_STRAIGHT = 1e-3
"""Below this angle in a step, rad, derivatives are computed by their series, as closed forms lose digits."""


@dataclass(frozen=True)
class CoordinatedTurn:
    """State (p, v, w): the horizontal velocity turns by w D in a step (Bar-Shalom et al., 2001, section 11.7).

        p' = p + R1(w) v,  v' = R2(w) v,  w' = w + noise of c turn_rate_std

    Speed and height change as in the nearly-constant-velocity model of the same q. dt: D (s). acceleration_std: q
    (m/s^2). turn_rate_std: of w before the first step (rad/s). turn_rate_change: c, None: sqrt(D), so that w changes by
    turn_rate_std in a second. keeps_speed: while ranges correct its heading, see `turned`.
    """

    dt: float
    acceleration_std: float
    axes: int = 3
    turn_rate_std: float = 1.0
    turn_rate_change: float | None = None
    keeps_speed: bool = False

    @classmethod
    def of(cls, settings: MotionSettings) -> Self:
        """The model of these settings."""
        told = settings.turn_rate_std, settings.turn_rate_change, settings.keeps_speed
        return cls(settings.dt, settings.stepwise_std, settings.axes, *told)

    @property
    def size(self) -> int:
        """Position, velocity and the rate."""
        return 2 * self.axes + 1

    @property
    def extra_covariance(self) -> Floats:
        """That of the rate."""
        return np.square([[self.turn_rate_std]])

    @cached_property
    def process_noise(self) -> Floats:
        """Q, (s, s)."""
        straight = NearlyConstantVelocity(self.dt, self.acceleration_std, self.axes).process_noise
        noise = np.pad(straight, ((0, 1), (0, 1)))
        share = self.dt if self.turn_rate_change is None else self.turn_rate_change**2
        noise[-1, -1] = self.turn_rate_std**2 * share
        return noise

    def predict_state(self, state: Floats) -> Floats:
        """States (n, s) one step later."""
        return matvec(self._transition(state), state)

    def predict_covariance(self, covariance: Floats, state: Floats) -> Floats:
        """F P F^T + Q, with the Jacobian F at states (n, s)."""
        jacobian = self.jacobian(state)
        return np.asarray(jacobian @ covariance @ np.swapaxes(jacobian, 1, 2) + self.process_noise)

    def jacobian(self, state: Floats) -> Floats:
        """Derivatives (n, s, s) of the next state."""
        jacobian, x, y = self._transition(state), *state[:, self.axes : self.axes + 2].T
        rate = np.ascontiguousarray(state[:, -1])
        angle, dt = rate * self.dt, self.dt
        sine, cosine = np.sin(angle), np.cos(angle)
        near = np.abs(angle) < _STRAIGHT
        square = np.where(near, 1.0, angle * angle)
        along = np.where(near, -angle / 3.0 + angle**3 / 30.0, (angle * cosine - sine) / square) * dt**2
        aside = np.where(near, 0.5 - angle * angle / 8.0, (angle * sine - 1.0 + cosine) / square) * dt**2
        jacobian[:, 0, -1] = along * x - aside * y
        jacobian[:, 1, -1] = aside * x + along * y
        jacobian[:, self.axes, -1] = dt * (-sine * x - cosine * y)
        jacobian[:, self.axes + 1, -1] = dt * (cosine * x - sine * y)
        return jacobian

    def _transition(self, state: Floats) -> Floats:
        """The step of states (n, s) as matrices (n, s, s), for their own rates."""
        axes, dt = self.axes, self.dt
        angle = np.ascontiguousarray(state[:, -1]) * dt
        sine, cosine = np.sin(angle), np.cos(angle)
        turned = angle != 0.0
        safe = np.where(turned, angle, 1.0)
        along = dt * np.where(turned, sine / safe, 1.0)
        # 1 - cos loses digits for small angles.
        half = np.sin(0.5 * angle)
        aside = dt * np.where(turned, 2.0 * half * half / safe, 0.0)
        matrix = np.zeros((len(state), self.size, self.size))
        matrix[:, np.arange(self.size), np.arange(self.size)] = 1.0
        place = np.arange(axes)
        matrix[:, place, axes + place] = dt
        matrix[:, 0, axes] = matrix[:, 1, axes + 1] = along
        matrix[:, 0, axes + 1], matrix[:, 1, axes] = -aside, aside
        matrix[:, axes, axes] = matrix[:, axes + 1, axes + 1] = cosine
        matrix[:, axes, axes + 1], matrix[:, axes + 1, axes] = -sine, sine
        return matrix
