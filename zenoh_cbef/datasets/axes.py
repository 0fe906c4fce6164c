"""Whether a truth has two of its axes exchanged against those of the anchors."""

from __future__ import annotations

from dataclasses import replace

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.lateness import compared, scatter_about_truth

_AS_IT_IS = 0, 1, 2
_EXCHANGED = {("x", "y"): (1, 0, 2), ("x", "z"): (2, 1, 0), ("y", "z"): (0, 2, 1)}
_TIMES = 5.0
"""How much better a truth has to fit whose axes are right: more than a better clock does for a target in a room."""


def exchanged_axes(dataset: Dataset) -> tuple[str, str] | None:
    """The two axes of the truth that have to be exchanged for it to fit the ranges; None where none have.

    Fits are compared as for clocks (`lateness`), at times as they are.
    """
    chosen = compared(dataset)

    def misfit(order: tuple[int, ...]) -> float:
        return scatter_about_truth(replace(dataset, truth=dataset.truth[:, order]), chosen)

    found = {names: misfit(order) for names, order in _EXCHANGED.items()}
    best = min(found, key=lambda names: found[names])
    return best if found[best] * _TIMES < misfit(_AS_IT_IS) else None
