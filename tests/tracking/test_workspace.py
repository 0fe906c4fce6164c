"""Room that parts of a batch use in turn."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.tracking.consensus import Workspace


def test_room_is_laid_out_neighbour_by_neighbour_and_is_the_same_as_long_as_it_is_enough() -> None:
    room = Workspace()
    first = room.of(3, 4, 5)
    assert first.shape == (3, 4, 5)
    assert first.swapaxes(0, 1).flags.c_contiguous
    first[:] = np.arange(60.0).reshape(3, 4, 5)
    assert np.shares_memory(first, room.of(2, 5, 6))
    assert np.shares_memory(first, room.of(1, 1, 1))
    larger = room.of(3, 4, 6)
    assert larger.shape == (3, 4, 6)
    assert not np.shares_memory(first, larger)
