"""What passed on each link over time, as the receivers counted it."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats, Ints
from zenoh_cbef.log.read.receipts import Receipts
from zenoh_cbef.trace import Passing

_MOST_STRETCHES, _FEWEST_STRETCHES, _MOST_CELLS = 300, 40, 36_000


def passing_of(receipts: list[Receipts], source: Ints, destination: Ints, steps: int) -> Passing:
    """The messages of each link in each of some stretches of steps, as many as a page can hold."""
    fit = max(_FEWEST_STRETCHES, _MOST_CELLS // max(len(source), len(receipts), 1))
    until = np.unique(np.linspace(0, steps, min(steps, _MOST_STRETCHES, fit) + 1).round().astype(np.int64)[1:])
    counts = np.full((len(source), len(until), 4), np.nan)
    for agent, one in enumerate(receipts):
        known, fresh = one.fresh(0, steps)
        sums = _summed(np.searchsorted(until, known), fresh, len(until))
        for place, neighbour in enumerate(one.neighbours):
            counts[np.flatnonzero((source == neighbour) & (destination == agent))] = sums[:, place]
    return Passing(until, counts)


def _summed(stretch: Ints, fresh: Floats, count: int) -> Floats:
    """Counts summed and latencies averaged, of each step (m, 4, d), over stretches: (count, d, 4), NaN for nothing.

    A message that is found to be late was counted as lost before, so a stretch's losses can be below zero: none then.
    """
    found = np.zeros((count, fresh.shape[2], 4))
    timed = np.zeros(found.shape[:2])
    np.add.at(found, stretch, np.moveaxis(np.nan_to_num(fresh), 1, 2))
    np.add.at(timed, stretch, np.isfinite(fresh[:, 3]))
    with np.errstate(divide="ignore", invalid="ignore"):
        found[:, :, 3] = np.where(timed > 0, found[:, :, 3] / timed, np.nan)
    found[np.bincount(stretch, minlength=count) == 0] = np.nan
    return np.asarray(np.maximum(found, 0.0))
