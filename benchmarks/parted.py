"""Honest agents beside a liar: whether they find it, and the groups into which it parts them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from rich.table import Table

from benchmarks.common import drawn, plain_table
from benchmarks.reach import groups
from benchmarks.stress import FIRST, SEEDS, believed, cases, scenario_of, yardsticks
from zenoh_cbef.analysis.faulted import honest_agents
from zenoh_cbef.analysis.metrics import Analysis, analyze
from zenoh_cbef.analysis.strong import strong
from zenoh_cbef.analysis.strong.told import told
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.simulator import simulate
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking.status import TRACKING

CASE = "message-liar"
NEAR, STEPS = 1.3, 20
FOUND = (
    f"below {NEAR} of the centralised filter of honest ranges",
    "of the best one of the ranges that reach each agent",
    f"all neighbours name the liar within {STEPS} steps",
    "an honest agent is named",
)
COLUMNS = ("seed", "agents", "RMSE (m)", "strong, their ranges alone", "NEES/d", "tracking (%)")


def run(repeats: int, seeds: int = SEEDS, first: int = FIRST) -> Iterator[Table]:
    """All seeds in a row, and a row for each group of a seed in which there are several; nothing is timed."""
    del repeats
    one = scenario_of(cases()[CASE])
    with np.errstate(all="ignore"):
        traces = simulate(drawn(one, seeds, first))
        done = analyze([believed(trace) for trace in traces])
        best = np.fmin(*yardsticks([each.trace for each in done], done[0].first)[:2])
        parted = [each for each in done if len(_groups(each.trace)) > 1]
        rows = [_row(each, group) for each in parted for group in _groups(each.trace)]
    near = sum((each.metrics.ratio_to_centralized or np.inf) < NEAR for each in done)
    known = sum(pick(each.metrics, "position_rmse") < NEAR * most for each, most in zip(done, best, strict=True))
    found = [_named(trace) for trace in traces]
    name = f"{CASE}: {seeds} seeds from {first}"
    yield plain_table(name, FOUND, [[near, known, sum(all_ for all_, _ in found), sum(honest for _, honest in found)]])
    yield plain_table(f"{name}, groups in {len(parted)} of them", COLUMNS, rows)


def _groups(trace: Trace) -> list[list[int]]:
    """The groups of honest agents that reach each other without a liar."""
    return groups(trace, honest_agents(trace.scenario))


def _named(trace: Trace) -> tuple[bool, bool]:
    """Whether all honest neighbours of liars have named one in the first steps, and whether any named an honest one."""
    honest, named = honest_agents(trace.scenario), trace.diagnostics.isolated
    beside = {a for edge in trace.edges.tolist() for a, b in (edge, edge[::-1]) if honest[a] and not honest[b]}
    said = named[honest][np.isfinite(named[honest])].astype(np.int64)
    return bool(np.isfinite(named[sorted(beside), STEPS - 1]).all()), bool(honest[said].any())


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
