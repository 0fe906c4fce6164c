"""Motions of which the arithmetic is the same, as rows of one batch: for few rows calls cost more than numbers do."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.motion import Motion, turns

_FEW = 64
"""For how many rows of each motion that pays. Bits are the same either way."""

Arrays = tuple[Floats, ...]
"""Arrays with a row for each agent, (n, ...)."""


def abreast(
    motions: Sequence[Motion], each: Sequence[Arrays], compute: Callable[[Motion, Arrays], Arrays]
) -> list[Arrays]:
    """What is computed of each motion, row by row, from the arrays of each: of those that are alike in one call.

    Motions are alike whose states are as long, and all of which ranges turn, or none.
    """
    groups: dict[tuple[int, bool, int], list[int]] = {}
    few = len(each[0][0]) <= _FEW
    for place, motion in enumerate(motions):
        groups.setdefault((motion.size, turns(motion), 0 if few else place), []).append(place)
    found: dict[int, Arrays] = {}
    for places in groups.values():
        rows = tuple(np.concatenate(parts) for parts in zip(*(each[place] for place in places), strict=True))
        told = [np.split(one, len(places)) for one in compute(motions[places[0]], rows)]
        found |= zip(places, zip(*told, strict=True), strict=True)
    return [found[place] for place in range(len(motions))]
