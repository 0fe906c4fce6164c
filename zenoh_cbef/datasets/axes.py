"""Whether a truth has two of its axes exchanged against those of the anchors."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.lateness import compared, scatter_about_truth

_NAMES = "xyz"
_TIMES = 5.0
"""How much better a truth has to fit whose axes are right: more than a better clock does for a target in a room."""


def exchanged_axes(dataset: Dataset) -> tuple[str, str] | None:
    """The two axes of the truth that have to be exchanged for it to fit the ranges; None where none have.

    Fits are compared as for clocks (`lateness`), at times as they are.
    """
    chosen = compared(dataset)
    pairs = list(combinations(range(3), 2))

    def misfit(order: tuple[int, ...]) -> float:
        return scatter_about_truth(replace(dataset, truth=dataset.truth[:, order]), chosen)

    found = [misfit(tuple(other if axis == one else one if axis == other else axis for axis in range(3)))
             for one, other in pairs]  # fmt: skip
    best = int(np.argmin(found))
    if not np.isfinite(found[best]) or found[best] * _TIMES > misfit((0, 1, 2)):
        return None
    one, other = pairs[best]
    return _NAMES[one], _NAMES[other]
