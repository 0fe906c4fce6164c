"""Rough fixes of the target from a recording's own ranges, without any filter: for pictures, and for checks.

With |p - a|^2 = r^2, p is a linear function of squared ranges but for |p|^2, which is taken for one more unknown. In a
plane, where anchors are at one height, that unknown takes up the target's height, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.datasets.dataset import Dataset

_FLAT = 0.05
"""Anchors whose heights differ by less than this share of their extent do not tell the target's height."""
_MOST = 200


@dataclass(frozen=True)
class Fixes:
    """Fixes in some moments of a recording.

    time: (f,), s. places: (f, 2) in a plane, else (f, 3), m. misfit: (f,), how far ranges are off, RMS, m; NaN where
    the fix has no range to spare. squared_height: (f,), m^2, of the target above or below the plane; where it is
    negative, and without a plane, by how much the ranges contradict the fix.
    """

    time: Floats
    places: Floats
    misfit: Floats
    squared_height: Floats


def is_planar(dataset: Dataset) -> bool:
    """Whether the anchors are at one height."""
    extent = np.ptp(dataset.anchors, axis=0)
    return bool(extent[2] <= _FLAT * extent[:2].max())


def moments(dataset: Dataset) -> tuple[Floats, Floats]:
    """Moments (f,) in which most anchors measured, and the mean range of each anchor around it (f, n), NaN for none."""
    begin, end = float(dataset.range_time[0]), float(dataset.range_time[-1])
    length = max(2.0 * (dataset.interval or (end - begin)), 1e-6)
    count = int(np.clip((end - begin) / length, 1, _MOST))
    starts = begin + np.arange(count) * (end - begin - length) / max(1, count - 1) if end - begin > length else [begin]
    means = np.full((len(starts), len(dataset.anchors)), np.nan)
    for row, start in enumerate(starts):
        first, last = np.searchsorted(dataset.range_time, [start, start + length + 1e-9])
        anchor, ranges = dataset.range_anchor[first:last], dataset.ranges[first:last]
        number = np.bincount(anchor, minlength=means.shape[1])
        total = np.bincount(anchor, weights=ranges, minlength=means.shape[1])
        means[row, number > 0] = total[number > 0] / number[number > 0]
    return np.asarray(starts) + 0.5 * length, means


def fixes(dataset: Dataset, anchors: Floats | None = None) -> Fixes:
    """The fixes of a recording. anchors: (n, 3), other places of them to try."""
    places = (dataset.anchors if anchors is None else anchors)[:, : 2 if is_planar(dataset) else 3]
    times, means = moments(dataset)
    axes = places.shape[1]
    centre = places.mean(axis=0)
    rows = np.column_stack([-2.0 * (places - centre), np.ones(len(places))])
    squares = np.sum((places - centre) ** 2, axis=1)
    found, misfit, heights, kept = [], [], [], []
    for time, ranges in zip(times, means, strict=True):
        there = np.isfinite(ranges)
        if there.sum() <= axes or np.linalg.matrix_rank(rows[there]) <= axes:
            continue
        solved = np.linalg.lstsq(rows[there], ranges[there] ** 2 - squares[there], rcond=None)[0]
        off = rows[there] @ solved + squares[there] - ranges[there] ** 2
        spare = int(there.sum()) - axes - 1
        found.append(solved[:axes] + centre)
        heights.append(float(solved[axes] - np.sum(solved[:axes] ** 2)))
        kept.append(time)
        errors = off / np.maximum(2.0 * ranges[there], 1e-9)
        misfit.append(float(np.sqrt(np.sum(errors**2) / spare)) if spare else np.nan)
    return Fixes(np.array(kept), np.array(found).reshape(-1, axes), np.array(misfit), np.array(heights))
