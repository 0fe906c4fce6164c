"""Honest agents that a liar parts into groups: how good each group is, and how good it could be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from rich.table import Table

from benchmarks.common import plain_table
from benchmarks.stress import FIRST, SEEDS, cases, scenario_of
from zenoh_cbef.analysis.metrics import Analysis, analyze, counted_agents
from zenoh_cbef.analysis.strong import strong
from zenoh_cbef.analysis.strong.told import told
from zenoh_cbef.simulator import simulate
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking import graph
from zenoh_cbef.tracking.status import TRACKING

CASE = "message-liar"
COLUMNS = ("seed", "agents", "RMSE (m)", "strong, their ranges alone", "NEES/d", "tracking (%)")


def groups(trace: Trace) -> list[list[int]]:
    """The groups of honest agents that reach each other without a liar."""
    honest = counted_agents(trace)
    edges = trace.edges[honest[trace.edges].all(axis=1)]
    return [each for each in graph.components(len(honest), edges) if honest[each].all()]


def run(repeats: int, seeds: int = SEEDS, first: int = FIRST) -> Iterator[Table]:
    """One row for each group of a seed in which there are several; nothing is timed."""
    del repeats
    one = scenario_of(cases()[CASE])
    scenarios = [one.model_copy(update={"seed": first + more}) for more in range(seeds)]
    rows: list[list[object]] = []
    with np.errstate(all="ignore"):
        parted = [each for each in scenarios if len(groups(simulate([each.model_copy(update={"steps": 1})])[0])) > 1]
        for done in analyze(simulate(parted)):
            rows += [_row(done, group) for group in groups(done.trace)]
    yield plain_table(f"{CASE}: groups in {len(parted)} of {seeds} seeds from {first}", COLUMNS, rows)


def _row(done: Analysis, group: list[int]) -> list[object]:
    """A group's figures from the scored steps."""
    trace, window, size = done.trace, slice(done.first, None), len(done.trace.plan.space.kept)
    theirs = np.isin(np.arange(len(trace.ranges)), group)[:, None]
    states, _ = strong(*told([replace(trace, ranges=np.where(theirs, trace.ranges, np.nan))], len(trace.time)))
    off = np.linalg.norm(states[0, window, :3] - trace.truth[window, :3], axis=1)
    return [
        trace.scenario.seed,
        ", ".join(map(str, group)),
        float(np.sqrt(np.mean(done.position_error[group, window] ** 2))),
        float(np.sqrt(np.mean(off**2))),
        float(np.mean(done.nees[group, window])) / size,
        100.0 * float(np.mean(trace.diagnostics.status[group, window] == TRACKING)),
    ]
