"""What maps show of a large network: the agents nearest to the target, and the links between these."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from zenoh_cbef.analysis.figures import MOST_SHOWN
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.arrays import Floats, Ints
from zenoh_cbef.trace import Links, Passing, Trace

_ROWS = ("positions", "ranges", "age", "initial", "estimates", "covariances")
_ERRORS = ("counted", "msee", "position_error", "velocity_error", "nees")


def nearest(analysis: Analysis) -> Analysis:
    """The rows of the agents nearest to the target, where agents are more than maps show; else all of them.

    Metrics and yardsticks stay those of the whole network.
    """
    trace = analysis.trace
    if len(trace.estimates) <= MOST_SHOWN:
        return analysis
    away = np.linalg.norm(_middle(trace.positions) - _centre(trace), axis=1)
    agents = np.sort(np.argsort(np.where(np.isfinite(away), away, np.inf), kind="stable")[:MOST_SHOWN])
    errors = {name: getattr(analysis, name)[agents] for name in _ERRORS}
    return replace(analysis, trace=_part(trace, agents), **errors)


def _centre(trace: Trace) -> Floats:
    """Where the target was in the middle of the run, (3,); where that is unknown, the middle of the agents."""
    known = trace.truth[np.isfinite(trace.truth).all(axis=1), :3]
    return np.asarray(known[len(known) // 2] if len(known) else np.nanmean(_middle(trace.positions), axis=0))


def _middle(positions: Floats) -> Floats:
    """Where agents (n, K, 3) were in the middle of the run, (n, 3)."""
    return positions[:, positions.shape[1] // 2]


def _part(trace: Trace, agents: Ints) -> Trace:
    links, passing, inside = trace.links, trace.passing, np.full(len(trace.estimates), -1)
    inside[agents] = np.arange(len(agents))
    kept = (inside[links.source] >= 0) & (inside[links.destination] >= 0)
    some = {one.name: getattr(links, one.name)[kept] for one in fields(Links)}
    some |= {name: inside[some[name]] for name in ("source", "destination")}
    return replace(
        trace,
        **{name: getattr(trace, name)[agents] for name in _ROWS},
        diagnostics=trace.diagnostics.each(lambda values: values[agents]),
        edges=inside[trace.edges[(inside[trace.edges] >= 0).all(axis=1)]],
        links=Links(**some),
        passing=None if passing is None else Passing(passing.until, passing.counts[kept]),
        payloads=None,
        smoothed=None if trace.smoothed is None else trace.smoothed.of(agents),
        unlogged=None if trace.unlogged is None else trace.unlogged[agents],
        agents=agents,
    )
