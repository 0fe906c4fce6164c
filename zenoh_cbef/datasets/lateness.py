"""By how much a truth's clock is off that of the ranges: the shift with which it fits them best."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Floats
from zenoh_cbef.datasets.dataset import Dataset

_MOST = 500
"""Ranges that are compared; so many shifts, too."""
_FINER, _ROUNDS = 5, 6
_ENOUGH = 0.5
"""The share of the shorter of ranges and truth that a shift has to leave in common."""
_LEAST = 20
_ALIKE = 1.2
"""Of shifts whose misfits differ by less, as in rounds of a target, the smallest is meant."""
_TIMES, _SMALLEST = 2.0, 1e-3
"""How much better a truth has to fit when it is shifted, where it misses by more than a share of the usual range."""


def lateness(dataset: Dataset) -> float | None:
    """How many seconds the truth has to be put back to fit; None where it fits as well as it is, or nothing tells.

    A shift is judged by how much ranges scatter about the distances to the truth, each anchor's about their own median:
    so neither biases nor outliers count.
    """
    chosen = compared(dataset)
    begin, end = float(dataset.range_time[0]), float(dataset.range_time[-1])
    first, last = (float(dataset.truth_time[at]) for at in (0, -1))
    width = (last - begin) - (first - end)
    if len(dataset.truth) < 2 or width <= 0.0 or end <= begin:
        return None
    least = max(_LEAST, _ENOUGH * len(chosen) * min(1.0, (last - first) / (end - begin)))

    def misfits(shifts: Floats) -> Floats:
        return np.array([scatter_about_truth(dataset, chosen, shift, least) for shift in shifts])

    shifts = np.linspace(first - end, last - begin, _MOST)
    found = misfits(shifts)
    if not np.isfinite(found).any():
        return None
    [now] = misfits(np.zeros(1))
    near = np.flatnonzero(found <= (_ALIKE if np.isfinite(now) else 1.0) * found.min())
    best = float(shifts[near[np.argmin(np.abs(shifts[near]))]])
    step = width / (_MOST - 1)
    for _ in range(_ROUNDS):
        shifts = best + step * np.linspace(-1.0, 1.0, 2 * _FINER + 1)
        best = float(shifts[np.argmin(misfits(shifts))])
        step /= _FINER
    [then] = misfits(np.array([best]))
    return best if now > _SMALLEST * float(np.median(dataset.ranges)) and then < now / _TIMES else None


def compared(dataset: Dataset) -> NDArray[np.intp]:
    """The places of ranges that are compared, evenly spread."""
    return np.unique(np.linspace(0, len(dataset.ranges) - 1, _MOST).astype(np.intp))


def scatter_about_truth(dataset: Dataset, chosen: NDArray[np.intp], shift: float = 0.0, least: float = _LEAST) -> float:
    """How much ranges scatter about a truth that is taken `shift` seconds later, m; inf where too few have one."""
    times = dataset.range_time[chosen] + shift
    known = dataset.knows_truth(times)
    if known.sum() < least:
        return np.inf
    at, anchor = times[known], dataset.range_anchor[chosen][known]
    place = np.stack([np.interp(at, dataset.truth_time, axis) for axis in dataset.truth.T], axis=1)
    off = dataset.ranges[chosen][known] - np.linalg.norm(place - dataset.anchors[anchor], axis=1)
    for each in np.unique(anchor):
        off[anchor == each] -= np.median(off[anchor == each])
    return float(np.median(np.abs(off)))
