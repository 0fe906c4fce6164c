"""What every model of the target's motion is."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, Self

import numpy as np

from zenoh_cbef.arrays import Floats


@dataclass(frozen=True)
class MotionSettings:
    """What any model may need to know.

    dt: of a step, s. acceleration_std: q, m/s^2. axes: 3, or 2 in a plane. interval: how long a random acceleration
    lasts, s; None: one step. velocity_time: time constant of a velocity that decays, s. turn_rate_std: of a
    turn's rate before the first step, rad/s; turn_rate_change: by what share of it the rate changes in a step.
    throughout: whether a stationary target is pushed all the step long.
    keeps_speed: whether a target that turns does while ranges correct its heading.
    """

    dt: float
    acceleration_std: float
    axes: int = 3
    interval: float | None = None
    velocity_time: float = 10.0
    turn_rate_std: float = 1.0
    turn_rate_change: float | None = None
    throughout: bool = False
    keeps_speed: bool = False

    @property
    def stepwise_std(self) -> float:
        """Standard deviation of an acceleration that lasts one step, with the same power of the noise in a second."""
        if self.interval is None:
            return self.acceleration_std
        return self.acceleration_std * float(np.sqrt(self.interval / self.dt))


class Motion(Protocol):
    """A model of the motion. States begin with position and velocity along the axes; what follows is the model's own.

    The axes are three, or two where the target moves in a plane.
    """

    @property
    def dt(self) -> float:
        """Sampling time D, s."""

    @property
    def acceleration_std(self) -> float:
        """The acceleration that the model allows for, m/s^2."""

    @property
    def axes(self) -> int:
        """Number of axes."""

    @property
    def size(self) -> int:
        """Number of state components s."""

    @property
    def extra_covariance(self) -> Floats:
        """Covariance (e, e), before the first step, of the components that follow position and velocity."""

    @property
    def process_noise(self) -> Floats:
        """Q, (s, s): what a step adds to a covariance."""

    def predict_state(self, state: Floats) -> Floats:
        """States (n, s) one step later."""

    def predict_covariance(self, covariance: Floats, state: Floats) -> Floats:
        """Covariances (n, s, s) one step later, linearised at states (n, s)."""

    def jacobian(self, state: Floats) -> Floats:
        """Derivatives (n, s, s) of the next state, or (s, s) where they are the same at all states (n, s)."""


class NamedMotion(Motion, Protocol):
    """One that a scenario names."""

    @classmethod
    def of(cls, settings: MotionSettings) -> Self:
        """The model of these settings."""


@dataclass(frozen=True)
class LinearMotion:
    """x(k+1) = A x(k) + w(k), w ~ N(0, Q).

    dt: sampling time D (s). acceleration_std: q (m/s^2). axes: 3, or 2 in a plane.
    """

    dt: float
    acceleration_std: float
    axes: int = 3

    @classmethod
    def of(cls, settings: MotionSettings) -> Self:
        """The model of these settings."""
        return cls(settings.dt, settings.stepwise_std, settings.axes)

    @cached_property
    def size(self) -> int:
        """Number of state components."""
        return 2 * self.axes

    @property
    def extra_covariance(self) -> Floats:
        """Nothing follows position and velocity."""
        return np.zeros((0, 0))

    @property
    @abstractmethod
    def transition(self) -> Floats:
        """A, (s, s)."""

    @property
    @abstractmethod
    def process_noise(self) -> Floats:
        """Q, (s, s)."""

    def predict_state(self, state: Floats) -> Floats:
        """A x for states (n, s)."""
        return np.asarray((self.transition @ state[:, :, None])[:, :, 0])

    def predict_covariance(self, covariance: Floats, state: Floats | None = None) -> Floats:  # noqa: ARG002
        """A P A^T + Q for covariances (n, s, s), wherever the state is."""
        return np.asarray(self.transition @ covariance @ self.transition.T + self.process_noise)

    def jacobian(self, state: Floats) -> Floats:  # noqa: ARG002
        """A, wherever the state is."""
        return self.transition


def along_axes(matrix: list[list[float]], axes: int) -> Floats:
    """A matrix about one axis, (m, m), for all of them: (m axes, m axes)."""
    return np.kron(np.array(matrix), np.eye(axes))


def linear(motion: Motion) -> LinearMotion:
    """The model, which is linear. Raises ValueError where it is not."""
    if not isinstance(motion, LinearMotion):
        raise ValueError(f"{type(motion).__name__} is not linear")  # noqa: TRY004 - a user chose it, not a caller
    return motion


def beside_constants(motion: LinearMotion, count: int) -> tuple[Floats, Floats]:
    """Transition and process noise, (s + count, s + count) each, of a state and count numbers that stay as they are."""
    size = motion.size
    transition = np.eye(size + count)
    transition[:size, :size] = motion.transition
    return transition, np.pad(motion.process_noise, ((0, count), (0, count)))


def begun(motion: Motion, state: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """States (n, s) and covariances (n, s, s) of a model from those of its first components, (n, 2 axes or more)."""
    known = state.shape[1] - 2 * motion.axes
    extra = motion.extra_covariance[known:, known:]
    if not len(extra):
        return state, covariance
    longer = ((0, 0), (0, len(extra)))
    widened = np.pad(covariance, (*longer, (0, len(extra))))
    widened[:, -len(extra) :, -len(extra) :] = extra
    return np.pad(state, longer), widened
