"""Where a target may be that some ranges fit: least squares from many places, and the distinct minima, best first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.analysis.strong.ranged import solved_below, square_root
from zenoh_cbef.arrays import Floats

_TRIED = 48
_TURNS = 25
_APART = 0.2
"""Minima nearer to each other than this share of the mean range are one."""


@dataclass(frozen=True)
class Circles:
    """Ranges of r runs: anchor (r, n, a), off (r, n), as in Heard; range (r, n), NaN where there is none; std: m."""

    anchor: Floats
    off: Floats
    range: Floats
    std: float

    def normal(self, place: Floats) -> tuple[Floats, Floats, Floats]:
        """Cost (r, t), gradient (r, t, a) and normal matrix (r, t, a, a) at places (r, t, a)."""
        known = np.isfinite(self.range)[:, None]
        offset = place[:, :, None] - self.anchor[:, None]
        distance = np.sqrt(np.sum(offset * offset, axis=3) + self.off[:, None])
        rows = np.where(known[..., None], offset / np.maximum(distance, 1e-300)[..., None], 0.0)
        error = np.where(known, self.range[:, None] - distance, 0.0)
        scaled = (error / (5.0 * self.std)) ** 2
        weighted = rows / (1.0 + scaled)[..., None]
        return np.log1p(scaled).sum(axis=2), np.sum(weighted * error[..., None], 2), np.swapaxes(weighted, 2, 3) @ rows

    def grid(self) -> tuple[Floats, Floats]:
        """Places to begin from, (r, t, a), and the mean range (r,), m."""
        known = np.isfinite(self.range)
        number = np.maximum(known.sum(axis=1), 1)
        reach = np.maximum(np.abs(np.where(known, self.range, 0.0)).sum(axis=1) / number, 10.0 * self.std)
        middle = np.where(known[..., None], self.anchor, 0.0).sum(axis=1) / number[:, None]
        apart = np.where(known, np.linalg.norm(self.anchor - middle[:, None], axis=2), 0.0).max(axis=1)
        direction = np.random.default_rng(0).standard_normal((_TRIED, middle.shape[1]))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        size = np.linspace(0.1, 1.0, _TRIED)[:, None] * direction
        return middle[:, None] + (reach + apart)[:, None, None] * size, reach


def starts(circles: Circles, wanted: int) -> tuple[Floats, Floats]:
    """The best places (r, wanted, a), m, and how wide a first guess about them should be, (r,), m.

    Levenberg-Marquardt with the weights of Cauchy, so that a few wrong ranges do not decide. Where fewer minima are
    distinct, the best comes again.
    """
    place, reach = circles.grid()
    axes = place.shape[2]
    damping = np.full(place.shape[:2], 1e-3)
    cost, gradient, square = circles.normal(place)
    for _ in range(_TURNS):
        scale = np.trace(square, axis1=2, axis2=3) / axes
        damped = square + (damping * scale + 1e-12 * scale + 1e-300)[..., None, None] * np.eye(axes)
        root = square_root(damped)
        below = solved_below(
            root, np.concatenate([gradient[..., None], np.broadcast_to(np.eye(axes), damped.shape)], axis=3)
        )
        tried = place + (np.swapaxes(below[..., 1:], 2, 3) @ below[..., :1])[..., 0]
        found = circles.normal(tried)
        better = found[0] < cost
        place = np.where(better[..., None], tried, place)
        cost = np.where(better, found[0], cost)
        gradient = np.where(better[..., None], found[1], gradient)
        square = np.where(better[..., None, None], found[2], square)
        damping = np.clip(np.where(better, 0.2 * damping, 5.0 * damping), 1e-9, 1e9)
    return _distinct(place, cost, _APART * reach, wanted), np.maximum(10.0 * circles.std, 0.1 * reach)


def _distinct(place: Floats, cost: Floats, apart: Floats, wanted: int) -> Floats:
    runs, left = np.arange(len(place)), np.where(np.isfinite(cost), cost, 1e300)
    chosen: list[Floats] = []
    for _ in range(wanted):
        best = left.argmin(axis=1)
        none = ~np.isfinite(left[runs, best])
        chosen.append(np.where(none[:, None], chosen[0] if chosen else place[:, 0], place[runs, best]))
        near = np.linalg.norm(place - chosen[-1][:, None], axis=2) < apart[:, None]
        left = np.where(near, np.inf, left)
    return np.stack(chosen, axis=1)
