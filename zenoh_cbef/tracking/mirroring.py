"""Planes near which agents are, and mirror images in them: ranges hardly tell a target from its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.linalg import matvec

Plane = tuple[tuple[float, ...], tuple[float, ...]]
"""A point of it and its normal, by the estimated axes, m and 1."""

APART = 5.0
"""By how many claimed errors an estimate has to differ from its mirror image."""


@dataclass(frozen=True)
class Sides:
    """On which side of a plane n estimates are. normal: (n, axes), of it. height, m, and rise, m/s: (n,)."""

    normal: Floats
    height: Floats
    rise: Floats

    @classmethod
    def beside(cls, state: Floats, point: Floats, normal: Floats) -> Self:
        """Of estimates (n, s), each beside a plane of its own: points and normals (n, axes)."""
        axes = normal.shape[1]
        height = np.add.reduce(normal * (state[:, :axes] - point), axis=1)
        return cls(normal, height, np.add.reduce(normal * state[:, axes : 2 * axes], axis=1))

    @classmethod
    def of(cls, state: Floats, plane: Plane) -> Self:
        """Of estimates (n, s) beside one plane."""
        point, normal = (np.tile(one, (len(state), 1)) for one in plane)
        return cls.beside(state, point, normal)

    def unsure(self, covariance: Floats) -> Bools:
        """Which estimates with these covariances (n, s, s) may be their own mirror images."""
        apart, spread = self._apart(covariance)
        return np.asarray(4.0 * apart < APART**2 * spread)

    def likelier(self, covariance: Floats) -> Floats:
        """The logarithm of how many times likelier estimates are than their mirror images, (n,), by what they claim."""
        apart, spread = self._apart(covariance)
        return np.asarray(2.0 * apart / np.maximum(spread, np.finfo(np.float64).tiny))

    def _apart(self, covariance: Floats) -> tuple[Floats, Floats]:
        """y^T adj(Y) y and det Y of y = (height, rise) and its covariance Y, (n,) each."""
        axes = self.normal.shape[1]

        def variance(one: int, other: int) -> Floats:
            part = np.ascontiguousarray(covariance[:, one : one + axes, other : other + axes])
            return np.asarray(np.add.reduce(self.normal * matvec(part, self.normal), axis=1))

        first, both, second = variance(0, 0), variance(0, axes), variance(axes, axes)
        apart = self.height**2 * second - 2.0 * self.height * self.rise * both + self.rise**2 * first
        return np.asarray(apart), np.asarray(first * second - both * both)

    def proved(self, age: Floats, place: Floats, speed: float) -> Bools:
        """Whether a guess with these deviations, (n,) m and m/s, that is so old, (n,) s, tells the side."""
        apart = ((self.height - age * self.rise) / place) ** 2 + (self.rise / speed) ** 2
        return np.asarray(4.0 * apart >= APART**2)


def turned(vectors: Floats, plane: Plane) -> Floats:
    """Vectors (n, s) that begin with a part along the position's axes and one along the velocity's, mirrored."""
    return np.asarray(np.add.reduce(_reflection(plane, vectors.shape[1]) * vectors[:, None, :], axis=2))


def _reflection(plane: Plane, size: int) -> Floats:
    """What mirrors the directions in a state of so many numbers, (size, size)."""
    normal = np.array(plane[1])
    axes, whole = len(normal), np.eye(size)
    whole[: 2 * axes, : 2 * axes] = np.kron(np.eye(2), np.eye(axes) - 2.0 * normal[:, None] * normal)
    return whole


def mirrored(state: Floats, covariance: Floats, plane: Plane) -> tuple[Floats, Floats]:
    """The mirror images of states (n, s) and covariances (n, s, s) that begin with position and velocity."""
    point, normal = map(np.array, plane)
    axes, whole = len(normal), _reflection(plane, state.shape[1])
    image = turned(state, plane)
    image[:, :axes] += 2.0 * np.add.reduce(point * normal) * normal
    return image, whole @ covariance @ whole.T


def seen_from(plane: Plane | None, middle: Sequence[float]) -> Plane | None:
    """The same plane, its point counted from a point in the middle, m; None: none."""
    return plane and (tuple(one - other for one, other in zip(plane[0], middle, strict=True)), plane[1])
