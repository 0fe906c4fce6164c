"""Corrections of a fix get smaller from pass to pass, so that a few wrong ranges do not drive it away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats

_SMALLER, _SURER = 0.7, 0.5
"""What each pass leaves of the largest correction, and of what a correction excuses ranges from being outliers."""


@dataclass(frozen=True)
class Damping:
    """How far Gauss-Newton may move a fix in its pass j = 1, 2, ..., and what range that move excuses.

        |dx| <= 0.7^(j - 1) max(h, |x - m|),     excused: 0.5^(j + 1) h

    h, m: the diagonal, and the middle, of the agents' box. From outside of that box all directions are nearly
    one, so a range that is wrong by as much as the box is wide moves a fix far across them; and the larger the move,
    the fewer ranges count as outliers (see `FirstFix`). So a fix of few ranges, some of them wrong, swings to and fro,
    further each time, until its passes end. With limits that shrink it comes to rest, and what then is far off is an
    outlier, as in a graduated search (Blake and Zisserman, Visual Reconstruction, 1987).

    middle: m, (axes,), diagonal: h, m.
    """

    middle: tuple[float, ...]
    diagonal: float

    def __call__(self, before: Floats, after: Floats, passes: float | Floats) -> tuple[Floats, Floats]:
        """The fix after a pass, (n, s), and the correction by which the next one excuses ranges. passes: j, or (n,)."""
        axes, step = len(self.middle), after - before
        size = _length(step[:, :axes])
        scale = np.maximum(self.diagonal, _length(before[:, :axes] - np.array(self.middle)))
        count = np.maximum(passes, 0.0)
        most = scale * np.where(count > 0.0, _SMALLER ** (count - 1.0), np.inf)
        excuses = self.diagonal * _SURER ** (count + 1.0)
        return before + _at_most(most, size)[:, None] * step, _at_most(excuses, size)[:, None] * step


def corrected(damping: Damping | None, before: Floats, after: Floats, passes: float | Floats) -> tuple[Floats, Floats]:
    """The same, damped or as ranges ask for."""
    return (after, after - before) if damping is None else damping(before, after, passes)


def _length(vectors: Floats) -> Floats:
    return np.asarray(np.sqrt(np.add.reduce(vectors * vectors, axis=1)))


def _at_most(most: Floats, size: Floats) -> Floats:
    """By what vectors of this size are multiplied that are to be no longer."""
    return np.asarray(np.minimum(size, most) / np.maximum(size, np.finfo(np.float64).tiny))
