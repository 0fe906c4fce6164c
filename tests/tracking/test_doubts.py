"""What an agent keeps of what the network supposes."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from zenoh_cbef.tracking.filters.finding.doubts import Doubts

BUSY = ("doing", "vote", "rest", "left", "open")


def test_a_network_in_which_an_agent_is_busy_in_any_way_is_not_at_rest():
    first, busy = Doubts.first(3, 5, 4), np.array([0.0, 1.0, 0.0])
    assert first.none
    for some in (*combinations(BUSY, 1), *combinations(BUSY, 2)):
        assert not replace(first, **dict.fromkeys(some, busy)).none, some
