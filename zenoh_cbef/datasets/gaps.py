"""Long times without any range, and ranges whose times are far from all others."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.words import counted

_INTERVALS = 20.0
"""The longest time without a range that is no silence, in usual intervals of an anchor."""
_FEW = 0.01
"""At most this share of all ranges is far from the others."""


def gap(dataset: Dataset) -> str:
    """The longest time without a range in a sentence; "" where that is nothing unusual.

    Where the few ranges on one side of it are further from the others than those are from each other, the sentence says
    so.
    """
    times = dataset.range_time
    if dataset.interval is None or len(times) < 2:
        return ""
    last = int(np.argmax(np.diff(times)))
    longest = times[last + 1] - times[last]
    if longest <= _INTERVALS * dataset.interval:
        return ""
    few, most = sorted((times[: last + 1], times[last + 1 :]), key=len)
    if len(few) > _FEW * len(times) or longest <= most[-1] - most[0]:
        return f"no range from {times[last]:.12g} to {times[last + 1]:.12g} s"
    return (
        f"{counted(len(few), 'range')} at t = {few[0]:.12g} s far from all others, which are from {most[0]:.12g} to "
        f"{most[-1]:.12g} s; leave out what is far, or correct its time"
    )
