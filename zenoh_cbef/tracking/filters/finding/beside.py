"""The plane in which agents are, and where an estimate is beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.linalg import matvec, unpack_upper

_FLAT = 1e-4
"""Agents are in one plane that are less off it than this share of how far they reach along it."""

APART = 5.0
"""By how many claimed errors an estimate has to differ from its mirror image."""


@dataclass(frozen=True)
class Beside:
    """Of n agents, what each knows.

    flat: (n,), whether places that it hears of leave an axis open; plane: whether just one. normal: (n, axes), of the
    plane. height, m, and rise, m/s: (n,), of its estimate.
    """

    flat: Bools
    plane: Bools
    normal: Floats
    height: Floats
    rise: Floats

    @classmethod
    def of(cls, state: Floats, told: Floats, near: float = 0.0) -> Self:
        """From estimates (n, s), and averages of places p and of p p^T, packed, from the same point.

        near: how far off a plane, m, root mean square, agents are in it all the same.
        """
        axes = next(axes for axes in (2, 3) if told.shape[1] == axes + axes * (axes + 1) // 2)
        middle = told[:, :axes]
        spread = unpack_upper(np.ascontiguousarray(told[:, axes:]), axes) - middle[:, :, None] * middle[:, None, :]
        sound = np.asarray(np.isfinite(spread).all(axis=(1, 2)))
        sizes, directions = np.linalg.eigh(np.where(sound[:, None, None], spread, 0.0))
        least = _FLAT**2 * sizes[:, -1]
        flat = sound & ((sizes[:, 0] < least) | (sizes[:, 0] <= near**2))
        normal = np.ascontiguousarray(directions[:, :, 0])
        height = np.add.reduce(normal * (state[:, :axes] - middle), axis=1)
        rise = np.add.reduce(normal * state[:, axes : 2 * axes], axis=1)
        return cls(flat, flat & (sizes[:, 1] > least), normal, height, rise)

    def unsure(self, covariance: Floats) -> Bools:
        """Which estimates with these covariances (n, s, s) may be their own mirror images."""
        axes = self.normal.shape[1]

        def variance(one: int, other: int) -> Floats:
            part = np.ascontiguousarray(covariance[:, one : one + axes, other : other + axes])
            return np.asarray(np.add.reduce(self.normal * matvec(part, self.normal), axis=1))

        first, both, second = variance(0, 0), variance(0, axes), variance(axes, axes)
        apart = self.height**2 * second - 2.0 * self.height * self.rise * both + self.rise**2 * first
        return np.asarray(4.0 * apart < APART**2 * (first * second - both * both))

    def proved(self, age: Floats, place: Floats, speed: float) -> Bools:
        """Whether a guess with these deviations, (n,) m and m/s, that is so old, (n,) s, tells the side."""
        apart = ((self.height - age * self.rise) / place) ** 2 + (self.rise / speed) ** 2
        return np.asarray(4.0 * apart >= APART**2)
