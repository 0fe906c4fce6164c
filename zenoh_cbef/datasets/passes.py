"""Ranges that stand there twice, and passes of a recording that lie on each other as its clock went back."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.words import counted

_FEW = 0.01
"""Times that go back more often than from this share of ranges to the next are in no order."""
_LEAST = 10
"""Ranges of an anchor that each of two passes has in their common time."""


def copied(dataset: Dataset) -> list[str]:
    """How many ranges are copies of others, in a sentence."""
    rows = np.column_stack([dataset.range_time, dataset.range_anchor, dataset.ranges])
    copies = len(rows) - len(np.unique(rows, axis=0))
    if not copies:
        return []
    said = f"{counted(copies, 'range')} {'is a copy of another' if copies == 1 else 'are copies of others'}"
    remedy = "leave copies out, as import does: zenoh-cbef import FOLDER -o OTHER"
    return [f"{said}, with the same time, anchor and range; {remedy}"]


def overlaid(dataset: Dataset) -> list[str]:
    """Where the clock goes back in the order of the source, so that two passes lie on each other, in a sentence."""
    for anchor in range(len(dataset.labels)):
        mine = np.flatnonzero(dataset.range_anchor == anchor)
        times = dataset.range_time[mine if dataset.order is None else mine[np.argsort(dataset.order[mine])]]
        back = np.flatnonzero(np.diff(times) < 0.0)
        if not 0 < len(back) <= max(1.0, _FEW * len(times)):
            continue
        last = back[np.argmin(np.diff(times)[back])]
        former, latter = times[: last + 1], times[last + 1 :]
        begin, end = max(former.min(), latter.min()), min(former.max(), latter.max())
        if min(np.sum((each >= begin) & (each <= end)) for each in (former, latter)) >= _LEAST:
            said = f"the clock goes back from {times[last]:.12g} to {times[last + 1]:.12g} s"
            both = f"two passes lie on each other from {begin:.12g} to {end:.12g} s"
            return [f"{said}, and {both}; leave one out, or give it later times"]
    return []
