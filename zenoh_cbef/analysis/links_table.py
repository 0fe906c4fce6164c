"""The messages on each link as a table, with those that faults lost or delayed apart from those really lost or late."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef.analysis.plots import missed_share
from zenoh_cbef.pages.parts import Table, number
from zenoh_cbef.trace import Links

_MOST_ROWS = 200
_KINDS = {
    "injected_lost": "lost by faults",
    "real_lost": "really lost",
    "injected_late": "late by faults",
    "deadline_missed": "missed deadline",
    "corrupted": "damaged",
    "duplicated": "doubled",
}


def is_wide(links: Links) -> bool:
    """Whether the table needs the page's whole width."""
    return len(_happened(links)) > 1


def _happened(links: Links) -> list[str]:
    return [name for name in _KINDS if getattr(links, name).any()]


def links_table(links: Links, names: Sequence[str]) -> Table:
    """One row per directed link. What happened on no link has no column.

    Of very many links those that missed most are shown. names: of the agents.
    """
    share = missed_share(links)
    kinds = _happened(links)
    shown = np.argsort(-share, kind="stable")[:_MOST_ROWS] if len(share) > _MOST_ROWS else np.arange(len(share))
    rows = [
        [
            f"{names[links.source[row]]} → {names[links.destination[row]]}",
            *(str(getattr(links, name)[row]) for name in ("sent", "delivered", *kinds)),
            f"{100.0 * share[row]:.1f} %",
            number(1e3 * float(links.latency[row])),
        ]
        for row in shown
    ]
    heads = ["link", "sent", "delivered", *(_KINDS[name] for name in kinds), "missed", "latency (ms)"]
    caption = "Messages per directed link"
    if len(shown) < len(share):
        caption += f"; the {_MOST_ROWS} of {len(share)} links that missed most"
    if kinds:
        caption += "; missed: lost, late or damaged"
    return Table(caption, heads, rows)
