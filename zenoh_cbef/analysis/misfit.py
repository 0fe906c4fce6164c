"""Whether recorded ranges fit the positions of their anchors at all."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.analysis.results import Honesty
from zenoh_cbef.arrays import Floats
from zenoh_cbef.trace import Trace
from zenoh_cbef.words import counted

_SHARE = 0.2
"""A fifth of the usual range: no noise and no bias of a working sensor."""
_ABSURD = 100.0
"""Errors ten times as large as the covariance says: no tuning makes up for it."""
_ALIKE = 2.0
"""Ranges are so much farther off a truth that is on another clock, or in another unit; estimates follow ranges."""


def misfit_note(trace: Trace, first: int, nees: Honesty | None) -> str:
    """What a reader has to know of recorded ranges that do not fit the anchors, or the truth, at all; "" of others.

    An agent's ranges do not fit where half of them, from step index `first` on, are off the distances to its estimates
    by more than a fifth of the network's median range. That asks for no covariance and no known noise, and rare
    outliers do not matter.
    """
    offs, usual = _offsets(trace, first)
    bad = np.flatnonzero(offs > _SHARE * usual)
    if bad.size:
        names = [trace.scenario.agents.names[agent] for agent in bad[:8]]
        who = ", ".join(names) + (f" and {counted(bad.size - 8, 'other')}" if bad.size > 8 else "")
        return (
            f"the ranges do not fit the estimates: half of the ranges of agent {who} are off by "
            f"{offs[bad].min():.3g} m and more of {usual:.3g} m; check units (m) and the order of anchors"
        )
    if nees and nees.average is not None and nees.average > _ABSURD * nees.dimension:
        if _truth_fits(trace, first, offs):
            return (
                f"the network lost its target at times: NEES is {nees.average:.3g}, where {nees.dimension:g} is "
                "expected, though ranges fit the truth; the status and the errors of its steps say when"
            )
        return (
            f"the truth does not fit the estimates, which fit the ranges: NEES is {nees.average:.3g}, "
            f"where {nees.dimension:g} is expected; check the truth's unit (m), axes and clock, and the order of "
            "anchors: zenoh-cbef dataset check"
        )
    return ""


def _truth_fits(trace: Trace, first: int, offs: Floats) -> bool:
    """Whether ranges are hardly farther off the distances to the truth than off those to the estimates, by `offs`."""
    true, _ = _offsets(trace, first, np.broadcast_to(trace.truth, trace.estimates.shape))
    return bool(np.nanmedian(true) < _ALIKE * np.nanmedian(offs))


def _offsets(trace: Trace, first: int, states: Floats | None = None) -> tuple[Floats, float]:
    """How far half of each agent's ranges are off, (n,), NaN where it has none, and the median of all ranges; m.

    states: (n, K, 6), to which they should fit; the agents' estimates.
    """
    ranges = trace.ranges[:, first:]
    places = (trace.estimates if states is None else states)[:, first:, :3]
    distances = np.linalg.norm(places - trace.positions[:, first:], axis=2)
    off = np.abs(ranges - distances)
    medians = [np.median(row[np.isfinite(row)]) if np.isfinite(row).any() else np.nan for row in off]
    known = ranges[np.isfinite(ranges)]
    return np.array(medians), float(np.median(known)) if known.size else np.inf
