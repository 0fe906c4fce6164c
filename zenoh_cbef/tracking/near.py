"""Which points are near each other, found by cells and not by comparing all pairs."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from zenoh_cbef.arrays import Floats, Ints

_AT_ONCE = 1_000_000


def pairs_within(points: Floats, radius: float) -> Ints:
    """All pairs of points (n, 3) at most `radius` apart, the lower number first, sorted; (m, 2).

    A point is compared with those of its own cell and of the next ones; cells are as large as the radius, or larger.
    """
    most = np.ceil(len(points) ** (1.0 / 3.0))
    size = max(radius, float(np.ptp(points, axis=0).max(initial=0.0)) / most, 1e-300)
    cell = np.floor((points - points.min(axis=0)) / size).astype(np.int64) + 1
    across = cell.max(axis=0) + 2
    place = _place(cell, across)
    order = np.argsort(place, kind="stable")
    found = []
    for step in np.ndindex(3, 3, 3):
        other = _place(cell + np.array(step) - 1, across)
        begin, end = (np.searchsorted(place[order], other, side) for side in ("left", "right"))
        for first, second in _candidates(order, begin, end):
            near = np.sum((points[first] - points[second]) ** 2, axis=1) <= radius * radius
            found.append(np.stack([first[near], second[near]], axis=1))
    pairs = np.concatenate(found)
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))], dtype=np.int64)


def _place(cell: Ints, across: Ints) -> Ints:
    """The numbers of cells (n, 3)."""
    return np.asarray((cell[:, 0] * across[1] + cell[:, 1]) * across[2] + cell[:, 2])


def _candidates(order: Ints, begin: Ints, end: Ints) -> Iterator[tuple[Ints, Ints]]:
    """Each point with those from begin to end of an order that have a higher number; many pairs at a time."""
    many = end - begin
    breaks = np.flatnonzero(np.diff(np.cumsum(many) // _AT_ONCE)) + 1
    for low, high in pairwise([0, *breaks.tolist(), len(many)]):
        chosen, before = many[low:high], np.cumsum(many[low:high]) - many[low:high]
        first = np.repeat(np.arange(low, high), chosen)
        second = order[np.arange(len(first)) + np.repeat(begin[low:high] - before, chosen)]
        upward = first < second
        yield first[upward], second[upward]
