"""How well ranges fit the anchors and the truth, or one another: what tells another unit."""

from __future__ import annotations

import math

import numpy as np

from zenoh_cbef.arrays import Bools
from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.fixes import fixes, is_planar

TIMES, SMALLEST = 3.0, 0.02
"""How much better another unit has to fit, where ranges miss by more than a share of the usual one."""
NAMES = {"mm": "millimetres", "cm": "centimetres", "ft": "feet", "in": "inches"}


def misfit(dataset: Dataset, known: Bools) -> float:
    """By what share of the usual range ranges miss; inf where nothing tells. known: of which the truth is known."""
    usual = float(np.median(dataset.ranges))
    if usual <= 0.0:
        return math.inf
    if known.any():
        truth = dataset.truth_at(dataset.range_time[known])[:, :3]
        apart = np.linalg.norm(truth - dataset.anchors[dataset.range_anchor[known]], axis=1)
        return float(np.median(np.abs(dataset.ranges[known] - apart))) / usual
    found = fixes(dataset)
    if not found.time.size:
        return math.inf
    height = max(0.0, float(np.median(found.squared_height))) if is_planar(dataset) else 0.0
    off = float(np.median(np.abs(found.squared_height - height))) / (2.0 * usual)
    spare = found.misfit[np.isfinite(found.misfit)]
    return math.hypot(off, float(np.median(spare)) if spare.size else 0.0) / usual
