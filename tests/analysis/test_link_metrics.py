"""Metrics tell of links one by one, of very many of those that missed most, and of all together."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.analysis import link_metrics
from zenoh_cbef.analysis.link_metrics import links_of, totals_of
from zenoh_cbef.trace import Links


def counted(lost: list[int]) -> Links:
    """Links of ten messages each, of which so many were lost."""
    count, gone = len(lost), np.array(lost, dtype=np.int64)
    none = np.zeros(count, dtype=np.int64)
    return Links(
        source=np.arange(count, dtype=np.int64),
        destination=none,
        sent=none + 10,
        delivered=10 - gone,
        lost=gone,
        late=none,
        injected_lost=gone,
        injected_late=none,
        corrupted=none,
        duplicated=none,
        latency=np.full(count, np.nan),
    )


def test_of_very_many_links_those_that_missed_most_are_told_of_in_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    links = counted([0, 5, 0, 9, 1])
    assert [one.lost for one in links_of(links)] == [0, 5, 0, 9, 1]
    monkeypatch.setattr(link_metrics, "MOST", 3)
    assert [(one.source, one.lost) for one in links_of(links)] == [(1, 5), (3, 9), (4, 1)]


def test_totals_are_of_all_links(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link_metrics, "MOST", 1)
    found = totals_of(counted([0, 5, 0, 9, 1]))
    assert (found.links, found.sent, found.delivered, found.lost, found.injected_lost, found.late) == (
        5,
        50,
        35,
        15,
        15,
        0,
    )
