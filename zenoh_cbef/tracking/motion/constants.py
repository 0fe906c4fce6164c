"""A motion beside which the state has numbers that stay as they are, as biases of ranges do."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.motion.base import Motion


@dataclass(frozen=True)
class BesideConstants:
    """State (p, v, d, more): position, velocity, count constants d_i, and what else the motion has.

    So all motions between which a target switches begin with the same components. moving: the motion of the rest.
    cov(d) = std^2 I + common_std^2 1 1^T before the first step: what constants have in common is a part of each.
    """

    moving: Motion
    count: int
    std: float
    common_std: float = 0.0

    @property
    def dt(self) -> float:
        """Sampling time, s."""
        return self.moving.dt

    @property
    def acceleration_std(self) -> float:
        """That of the motion, m/s^2."""
        return self.moving.acceleration_std

    @property
    def axes(self) -> int:
        """Number of axes."""
        return self.moving.axes

    @property
    def size(self) -> int:
        """Number of state components."""
        return self.moving.size + self.count

    @property
    def extra_covariance(self) -> Floats:
        """Of the constants, and of what else the motion has, before the first step."""
        rest = self.moving.extra_covariance
        covariance = np.pad(rest, (self.count, 0))
        covariance[: self.count, : self.count] = np.square(self.std) * np.eye(self.count) + self.common_std**2
        return covariance

    @cached_property
    def _places(self) -> NDArray[np.intp]:
        """Where the components of the motion are."""
        begin = 2 * self.axes
        return np.array([*range(begin), *range(begin + self.count, self.size)])

    @cached_property
    def process_noise(self) -> Floats:
        """Q, (s, s): none of the constants."""
        noise = np.zeros((self.size, self.size))
        noise[np.ix_(self._places, self._places)] = self.moving.process_noise
        return noise

    def predict_state(self, state: Floats) -> Floats:
        """States (n, s) one step later."""
        ahead = state.copy()
        ahead[:, self._places] = self.moving.predict_state(np.ascontiguousarray(state[:, self._places]))
        return ahead

    def predict_covariance(self, covariance: Floats, state: Floats) -> Floats:
        """F P F^T + Q, with the Jacobian F at states (n, s)."""
        jacobian = self.jacobian(state)
        return np.asarray(jacobian @ covariance @ np.swapaxes(jacobian, -1, -2) + self.process_noise)

    def jacobian(self, state: Floats) -> Floats:
        """Derivatives (n, s, s) of the next state, or (s, s) where they are the same at all states (n, s)."""
        inner = self.moving.jacobian(np.ascontiguousarray(state[:, self._places]))
        jacobian = np.zeros((*inner.shape[:-2], self.size, self.size))
        jacobian[..., range(self.size), range(self.size)] = 1.0
        jacobian[..., self._places[:, None], self._places] = inner
        return jacobian


def constants_of(motion: Motion) -> int:
    """How many constants stand beside a motion."""
    return motion.count if isinstance(motion, BesideConstants) else 0


def moving_of(motion: Motion) -> Motion:
    """A motion without the constants beside it."""
    return motion.moving if isinstance(motion, BesideConstants) else motion
