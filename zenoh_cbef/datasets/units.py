"""Whether anchors and ranges can be in one unit."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.datasets.dataset import Dataset

_ODD = 10.0
"""How many times the triangle inequality must be broken before it is no noise."""


def misfit_of_units(dataset: Dataset) -> str:
    """In words how anchors and ranges break the triangle inequality many times; "" where they do not.

    Of ranges r and s that follow one another, of anchors d apart, |r - s| <= d <= r + s, up to noise and motion.
    """
    first, second = dataset.range_anchor[:-1], dataset.range_anchor[1:]
    apart = np.linalg.norm(dataset.anchors[first] - dataset.anchors[second], axis=1)
    chosen = apart > 0.0
    if not chosen.any():
        return ""
    apart, former, latter = apart[chosen], dataset.ranges[:-1][chosen], dataset.ranges[1:][chosen]
    for far, wide, words in (
        (apart, former + latter, "the anchors are {:.3g} times too far apart for the ranges"),
        (np.abs(former - latter), apart, "the ranges differ {:.3g} times too much for the anchors"),
    ):
        times = float(np.median(far / np.maximum(wide, np.finfo(float).tiny)))
        if times > _ODD:
            return words.format(times)
    return ""
