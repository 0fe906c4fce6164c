"""Anchors whose ranges fit each other's places."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.fixes import fixes, is_planar

_TIMES = 3.0
"""How much better another order of anchors has to fit."""
_SMALLEST = 0.02
"""Errors below this share of the usual range are no sign of anything."""
_MANY = 40


def swapped(dataset: Dataset) -> list[str]:
    """Two anchors whose ranges fit much better with each other's places."""
    pair = _swapped_by_truth(dataset) if dataset.has_truth else _swapped_by_fixes(dataset)
    if pair is None:
        return []
    one, two = (dataset.labels[anchor] for anchor in pair)
    return [f"anchor {one} and {two} look swapped: their ranges fit much better at each other's places"]


def _swapped_by_truth(dataset: Dataset) -> tuple[int, int] | None:
    truth = dataset.truth_at(dataset.range_time)[:, :3]
    known, count = np.isfinite(truth).all(axis=1), len(dataset.anchors)
    off = np.full((count, count), np.nan)
    for anchor in range(count):
        mine = known & (dataset.range_anchor == anchor)
        if mine.any():
            apart = np.linalg.norm(truth[mine][:, None] - dataset.anchors[None], axis=2)
            off[anchor] = np.median(np.abs(dataset.ranges[mine][:, None] - apart), axis=0)
    least = _SMALLEST * float(np.median(dataset.ranges))
    swaps = [
        pair
        for pair in combinations(range(count), 2)
        if all(off[a, a] > max(least, _TIMES * off[a, b]) for a, b in (pair, pair[::-1]))
    ]
    return max(swaps, key=lambda pair: off[pair[0], pair[0]] + off[pair[1], pair[1]], default=None)


def _swapped_by_fixes(dataset: Dataset) -> tuple[int, int] | None:
    count = len(dataset.anchors)
    if count < (4 if is_planar(dataset) else 5) or count > _MANY:
        return None

    def misfit(pair: tuple[int, ...]) -> float:
        order = np.arange(count)
        order[list(pair)] = pair[::-1]
        found = fixes(dataset, dataset.anchors[order]).misfit
        found = found[np.isfinite(found)]
        return float(np.median(found)) if found.size else np.inf

    now = misfit(())
    if not _SMALLEST * float(np.median(dataset.ranges)) < now < np.inf:
        return None
    swaps = {pair: misfit(pair) for pair in combinations(range(count), 2)}
    best = min(swaps, key=swaps.__getitem__)
    others = [off for pair, off in swaps.items() if pair != best]
    # Where several swaps fit alike, as in a rectangle, only a truth could tell which it is.
    return best if swaps[best] < now / _TIMES and swaps[best] < 0.5 * min(others) else None
