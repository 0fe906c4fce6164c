"""The messages on links as metrics: one by one, and all together."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from zenoh_cbef.analysis.results import LinkMetrics, LinkTotals
from zenoh_cbef.trace import Links

MOST = 10_000
"""So many links are told of one by one."""


def links_of(links: Links) -> list[LinkMetrics]:
    """The links one by one, in their order; of very many those that missed most."""
    *counts, _ = (one.name for one in fields(LinkMetrics))
    shown = np.arange(len(links.sent))
    if len(shown) > MOST:
        share = (links.sent - links.delivered) / np.maximum(links.sent, 1)
        shown = np.sort(np.argsort(-share, kind="stable")[:MOST])
    columns = [getattr(links, name)[shown].tolist() for name in counts]
    latency = [one if np.isfinite(one) else None for one in links.latency[shown].tolist()]
    return [LinkMetrics(*row) for row in zip(*columns, latency, strict=True)]


def totals_of(links: Links) -> LinkTotals:
    """What all links carried together."""
    _, *counts = (one.name for one in fields(LinkTotals))
    return LinkTotals(len(links.sent), *(int(getattr(links, name).sum()) for name in counts))
