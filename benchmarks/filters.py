"""docs/filters.md: every filter over many seeds and on recorded data, in one table per case.

`python -m benchmarks filters --write docs/filters.md --data FOLDER`; without --write the tables are printed.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.common import drawn, plain_table
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.analysis.traffic import other_bytes, round_bytes
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters import KINDS

SEEDS = 50
BEGIN, END = "<!-- tables: begin -->", "<!-- tables: end -->"
EMULATED: dict[str, tuple[str, tuple[str, ...]]] = {
    "`tracking`": ("tracking", ()),
    "`outliers`: 10 % of ranges too long": ("outliers", ()),
    "`tracking`, 30 % of all messages lost": ("tracking", ("fault=[{kind='loss', probability=0.3}]",)),
}
# The same settings for every set but what is known beforehand: step, height, and the receivers' noise.
RECORDED: dict[str, tuple[str, ...]] = {
    "lias_fast": ("dt=0.1", "filter.planar_height=0.97", "filter.range_std=0.1"),
    "adip_los_B4": ("dt=0.1", "filter.planar_height=1.0", "filter.range_std=0.1"),
    "plaza2": ("dt=0.25", "filter.planar_height=0.0", "filter.range_std=1.5"),
}
HEADS = ("filter", "position RMSE", "/ centralised", "velocity / centralised", "NEES", "NIS", "bytes", "CPU")


def measured(kind: str, name: str, overrides: Sequence[str], seeds: int) -> list[str]:
    """One filter's row: medians over seeds."""
    plan = load(name, [f"filter.kind={kind}", *overrides]).plan
    runs = drawn(plan.scenario, seeds)
    began = time.process_time()
    with np.errstate(all="ignore"):  # What diverges shows in its numbers.
        traces = simulate(runs)
        spent = time.process_time() - began
        found = [one.metrics for one in analyze(traces)]
    velocity = [pick(one, "velocity_rmse") / pick(one, "centralized.velocity_rmse") for one in found]
    cells = [
        _median([pick(one, "position_rmse") for one in found]) + " m",
        _median([pick(one, "ratio_to_centralized") for one in found]),
        _median(velocity),
        _median([pick(one, "nees.average") / pick(one, "nees.dimension") for one in found]),
        _median([pick(one, "nis.average") / pick(one, "nis.dimension") for one in found]),
        f"{other_bytes(plan) + plan.rounds * round_bytes(plan):.0f}",
        f"{1e6 * spent / (seeds * plan.scenario.length * plan.scenario.count):.0f} µs",
    ]
    return [f"`{kind}`", *cells]


def cases(data: Path | None, seeds: int) -> Iterator[tuple[str, list[list[str]]]]:
    """Each case's name and its rows, one per filter."""
    for title, (name, overrides) in EMULATED.items():
        yield f"{title}, medians of {seeds} seeds", [measured(kind, name, overrides, seeds) for kind in KINDS]
    if data is None:
        return
    for folder, overrides in RECORDED.items():
        path = ["target.motion=dataset", f"target.path={data / folder}", "filter.acceleration_std=1.0"]
        yield f"Recorded: {folder}", [measured(kind, "tracking", [*path, *overrides], 1) for kind in KINDS]


def run(repeats: int, *, data: Path | None = None, write: Path | None = None) -> Iterator[Table]:
    """Nothing is repeated. data: the folder that holds the recorded sets. write: the page to bring up to date."""
    del repeats
    parts = []
    for title, rows in cases(data, SEEDS):
        yield plain_table(title, HEADS, rows)
        lines = [f"| {' | '.join(cells)} |" for cells in (HEADS, ["---", *["---:"] * (len(HEADS) - 1)], *rows)]
        parts.append("\n".join([f"### {title}", "", *lines]))
    if write is not None:
        text = write.read_text(encoding="utf-8")
        before, after = text.split(BEGIN)[0], text.split(END)[1]
        write.write_text("\n\n".join([before + BEGIN, *parts, END + after]), encoding="utf-8")


def _median(values: Sequence[float]) -> str:
    finite = [value for value in values if np.isfinite(value)]
    if not finite:
        return "-"
    middle = float(np.median(finite))
    return f"{middle:.4g}" if middle < 1e4 else f"{middle:.1e}"
