"""A recording without the single ranges that lie far off those around them: what is left shows how the target moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.datasets.dataset import Dataset

_AROUND = 3
"""How many ranges before and after one its median is of: up to so many may be wrong, in any way."""

_FAR = 5.0
"""From how many times the usual size on a difference from that median is of a wrong range."""


def without_spikes(dataset: Dataset) -> Dataset:
    """The recording without ranges that are far off the median of those around them (Hampel's filter).

    Where a target goes straight on, that median is the range in the middle, so only noise and turns are differences.
    """
    kept = np.ones(len(dataset.ranges), dtype=bool)
    for anchor in range(len(dataset.anchors)):
        own = np.flatnonzero(dataset.range_anchor == anchor)
        kept[own] = _is_near(dataset.ranges[own])
    return replace(
        dataset,
        range_time=dataset.range_time[kept],
        range_anchor=dataset.range_anchor[kept],
        ranges=dataset.ranges[kept],
        order=None if dataset.order is None else dataset.order[kept],
    )


def _is_near(ranges: Floats) -> Bools:
    if len(ranges) <= 2 * _AROUND:
        return np.ones(len(ranges), dtype=bool)
    padded = np.pad(ranges, _AROUND, mode="reflect")
    off = np.abs(ranges - np.median(sliding_window_view(padded, 2 * _AROUND + 1), axis=1))
    # Of a target that goes on, most ranges are that median: their differences are none, and say nothing of the noise.
    usual = np.median(off[off > 0.0]) if off.any() else 0.0
    return np.asarray(off <= _FAR * usual)
