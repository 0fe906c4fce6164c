"""How a target may move: nearly constant velocities that differ in their noise, and turns of unknown rates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.analysis.strong.ranged import square_root
from zenoh_cbef.arrays import Floats

_SWITCH = 0.02
"""Chance that a manoeuvring target changes its model in a step."""


@dataclass(frozen=True)
class Turns:
    """Targets that turn about the vertical. acceleration: m/s^2. rate_std: rad/s, of the rate before it is known.

    wander: by how much the rate changes in a second, rad/s.
    """

    acceleration: float
    rate_std: float
    wander: float


@dataclass(frozen=True)
class Models:
    """m models: transition (m, d, d), noise (m, d, d), chance of a manoeuvring target to go from one to another (m, m).

    The last `turning` of them turn: the last state is their rate, which is unknown again in each step of the others.
    """

    dt: float
    axes: int
    transition: Floats
    noise: Floats
    chance: Floats
    turning: int

    @classmethod
    def of(
        cls,
        dt: float,
        accelerations: Floats,
        axes: int,
        extra: int,
        turns: tuple[Turns, ...] = (),
        *,
        jumping: bool = False,
    ) -> Models:
        """Straight models with these acceleration noises, m/s^2, and turns; extra: components that stay.

        jumping: the last noise is of a velocity that jumps, at any moment of a step, and not of one acceleration in it.
        """
        straight, every = len(accelerations), [*accelerations, *(one.acceleration for one in turns)]
        size, many = 2 * axes + extra + bool(turns), len(every)
        transition = np.tile(np.eye(size), (many, 1, 1))
        transition[:, :axes, axes : 2 * axes] = dt * np.eye(axes)
        gain = np.zeros((size, axes))
        gain[:axes], gain[axes : 2 * axes] = 0.5 * dt**2 * np.eye(axes), dt * np.eye(axes)
        noise = np.square(every)[:, None, None] * (gain @ gain.T)
        if jumping:
            # The mean over that moment t of what a jump does to the position, ((dt - t) jump)^2.
            noise[straight - 1, :axes, :axes] *= 4.0 / 3.0
        if turns:
            transition[:straight, -1, -1] = 0.0
            noise[:straight, -1, -1] = max(one.rate_std for one in turns) ** 2
            noise[straight:, -1, -1] = [one.wander**2 * dt for one in turns]
        chance = np.full((many, many), _SWITCH / max(1, many - 1))
        np.fill_diagonal(chance, 1.0 - _SWITCH if many > 1 else 1.0)
        return cls(dt, axes, transition, noise, chance, len(turns))

    def predict(self, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """Means (..., m, d) and covariances (..., m, d, d) one step later."""
        ahead = (self.transition @ mean[..., None])[..., 0]
        spread = self.transition @ covariance @ np.swapaxes(self.transition, 1, 2) + self.noise
        if self.turning:
            last = slice(len(self.transition) - self.turning, None)
            ahead[..., last, :], turned = self._turned(mean[..., last, :], covariance[..., last, :, :])
            spread[..., last, :, :] = turned + self.noise[last]
        return ahead, spread

    def _turned(self, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """Means and covariances of turning targets by the cubature points of Arasaratnam and Haykin (2009)."""
        size = mean.shape[-1]
        away = np.sqrt(size) * np.swapaxes(square_root(covariance), -1, -2)
        points = mean[..., None, :] + np.concatenate([away, -away], axis=-2)
        angle, horizontal = self.dt * points[..., -1], slice(self.axes, self.axes + 2)
        velocity = points[..., self.axes] + 1j * points[..., self.axes + 1]
        way = self.dt * velocity * np.exp(0.5j * angle) * np.sinc(0.5 * angle / np.pi)
        velocity = velocity * np.exp(1j * angle)
        points[..., :2] += np.stack([way.real, way.imag], axis=-1)
        points[..., 2 : self.axes] += self.dt * points[..., self.axes + 2 : 2 * self.axes]
        points[..., horizontal] = np.stack([velocity.real, velocity.imag], axis=-1)
        ahead = points.mean(axis=-2)
        apart = points - ahead[..., None, :]
        return ahead, np.swapaxes(apart, -1, -2) @ apart / (2.0 * size)
