"""How ranges are laid onto steps: which of them each step gets."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray


def shared_out(steps: NDArray[np.intp], length: int) -> Iterator[tuple[int, list[int]]]:
    """Which of the ranges that fall into ascending steps (r,) each step gets."""
    count = np.bincount(steps, minlength=length)
    # A step has room for one more if it is empty, or if its own range can move on in turn.
    room = np.zeros(length + 1, dtype=bool)
    for step in range(length - 1, -1, -1):
        room[step] = count[step] == 0 or (count[step] == 1 and room[step + 1])
    waiting: list[int] = []
    at = 0
    for step in range(length):
        here = [*waiting, *range(at, at + count[step])]
        at += count[step]
        waiting = [here.pop()] if len(here) > 1 and room[step + 1] else []
        if here:
            yield step, here
