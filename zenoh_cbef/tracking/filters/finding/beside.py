"""The plane in which agents are, as each hears of their places, and where its estimate is beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.linalg import unpack_upper
from zenoh_cbef.tracking.mirroring import Sides

_FLAT = 1e-4
"""Agents are in one plane that are less off it than this share of how far they reach along it."""


@dataclass(frozen=True)
class Beside:
    """Of n agents, what each knows.

    flat: (n,), whether places that it hears of leave an axis open; plane: whether just one. sides: of its estimate.
    """

    flat: Bools
    plane: Bools
    sides: Sides

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
        sides = Sides.beside(state, middle, np.ascontiguousarray(directions[:, :, 0]))
        return cls(flat, flat & (sizes[:, 1] > least), sides)
