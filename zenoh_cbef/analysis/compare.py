"""Runs side by side: one row of numbers each, and their error curves in one picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path

import numpy as np

from zenoh_cbef.analysis.averages import rms_over_agents
from zenoh_cbef.analysis.claimed import claimed_position_error
from zenoh_cbef.analysis.figures import agent_style, log_axis, log_limits, points_each
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.mixing import configured_scheme
from zenoh_cbef.analysis.plots import series
from zenoh_cbef.analysis.results import Number
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.arrays import Floats
from zenoh_cbef.extras import from_extra
from zenoh_cbef.pages.parts import Figure, Plot, Table, number, plots_of
from zenoh_cbef.pages.render import render
from zenoh_cbef.plain import Json
from zenoh_cbef.trace import Trace
from zenoh_cbef.writing import write_whole

SMOOTHED = "smoothed.position_rmse"

COLUMNS = {
    "position_rmse": "position RMSE (m)",
    "velocity_rmse": "velocity RMSE (m/s)",
    SMOOTHED: "smoothed position RMSE (m)",
    "ratio_to_centralized": "ratio to centralised",
    "msee.average": "average MSEE",
    "nees.average": "NEES",
    "nis.average": "NIS",
    "claimed_position_error": "claimed position error (m)",
    "disagreement": "disagreement (m)",
    "bytes_per_step": "bytes per step",
    "missed": "missed",
}
"""The metrics of a row, and the titles of their columns."""


@dataclass(frozen=True)
class Row:
    """What ran, and how well. metrics: by the names of COLUMNS, None where the run has none."""

    run: str
    filter: str
    agents: int
    steps: int
    seed: int
    consensus: str
    rounds: int
    complete: bool
    metrics: dict[str, Number]

    def as_json(self) -> dict[str, Json]:
        """The row as `compare --json` prints it."""
        told = asdict(self)
        metrics: dict[str, Json] = told.pop("metrics")
        return told | metrics


def row(analysis: Analysis, name: str) -> Row:
    """One run's row. missed: share of the messages between agents that were lost or late."""
    metrics, plan = analysis.metrics, analysis.trace.plan
    values = {column: pick(metrics, column) for column in COLUMNS}
    known = {column: value if np.isfinite(value) else None for column, value in values.items()}
    return Row(
        run=name,
        filter=metrics.filter,
        agents=metrics.agents,
        steps=metrics.steps,
        seed=metrics.seed,
        consensus=configured_scheme(plan),
        rounds=plan.rounds,
        complete=metrics.complete,
        metrics=known | {"missed": analysis.trace.links.missed},
    )


def filled(rows: Sequence[Row], columns: Mapping[str, str]) -> dict[str, str]:
    """The columns that some run has, without that of claimed errors where all have a truth."""
    truths = all(one.metrics["position_rmse"] is not None for one in rows)
    return {
        name: title
        for name, title in columns.items()
        if any(one.metrics[name] is not None for one in rows) and not (truths and name == "claimed_position_error")
    }


def names_of(traces: Sequence[Trace], paths: Sequence[Path]) -> list[str]:
    """The runs' names; with the log's path where two runs have the same."""
    runs = [trace.name for trace in traces]
    return [run if runs.count(run) == 1 else f"{run} ({path})" for run, path in zip(runs, paths, strict=True)]


def differences(traces: Sequence[Trace], names: Sequence[str]) -> list[str]:
    """Why rows cannot be compared with the first one, a sentence each."""
    first, said = traces[0], []
    for trace, name in zip(traces[1:], names[1:], strict=True):
        steps = min(len(first.time), len(trace.time))
        alike = first.ranges.shape[0] == trace.ranges.shape[0]
        what = {
            "another time step": not np.array_equal(first.time[:steps], trace.time[:steps]),
            "another truth": not _same(*_both_known(first.truth[:steps], trace.truth[:steps])),
            "other measurements": not (alike and _same(_logged_ranges(first, trace), _logged_ranges(trace, first))),
            "other places of the agents": not (alike and _same(first.positions[:, :steps], trace.positions[:, :steps])),
            "another first estimate": not (alike and _same(first.initial, trace.initial)),
            f"another number of steps ({len(trace.time)}, not {len(first.time)})": len(first.time) != len(trace.time),
        }
        found = [each for each, holds in what.items() if holds]
        if found:
            said.append(f"{name} has {', '.join(found)} than {names[0]}, so errors do not tell the filters apart")
    return said


def write_comparison(analyses: Sequence[Analysis], names: Sequence[str], path: Path) -> None:
    """Write the runs' rows, and their average MSEE and position error over time, as one HTML file that opens offline.

    Raises UserError where plotly is not installed, or the file cannot be written.
    """
    plotly = from_extra("plotly.offline", "the picture")
    figures = figures_of(analyses, names)
    text = render(
        "comparison.html",
        name="Runs compared",
        warnings=differences([one.trace for one in analyses], names),
        runs=table_of([row(one, name) for one, name in zip(analyses, names, strict=True)]),
        figures=figures,
        plots=plots_of(figures),
        plotly=plotly.get_plotlyjs(),
    )
    write_whole(path, text)


def table_of(rows: Sequence[Row]) -> Table:
    """The runs as a table of texts."""
    caption = "The whole window of each run; missed: share of the messages that were lost or late"
    shown = filled(rows, COLUMNS)
    told = [
        [one.run, one.filter, f"{one.rounds}, {one.consensus}", *(number(one.metrics[name]) for name in shown)]
        for one in rows
    ]
    return Table(caption, ["run", "filter", "rounds", *shown.values()], told)


def figures_of(analyses: Sequence[Analysis], names: Sequence[str]) -> list[Figure]:
    """The runs' average MSEE and position error over time."""
    caption = "A click on a name in the legend hides or shows its line."
    if not any(one.metrics.scored.steps for one in analyses):
        claimed = [rms_over_agents(claimed_position_error(one.trace)) for one in analyses]
        unit = "claimed position error, RMS (m)"
        told = f"What covariances claim: no truth is known. {caption}"
        plot = _curves([one.trace.time for one in analyses], claimed, names, unit)
        return [Figure("position-error", "Position error as claimed", told, plot)]
    average = [one.msee_average for one in analyses]
    error = [rms_over_agents(one.position_error) for one in analyses]
    times = [one.trace.time for one in analyses]
    unit = "average MSEE (m² + m²/s²)"
    return [
        Figure("msee-average", "Average MSEE", caption, _curves(times, average, names, unit)),
        Figure("position-error", "Position error", caption, _curves(times, error, names, "position error, RMS (m)")),
    ]


def _curves(times: Sequence[Floats], values: Sequence[Floats], names: Sequence[str], title: str) -> Plot:
    lines = [
        series(time, line, points_each(len(names)), agent_style(place), 1.6) | {"name": escape(name)}
        for place, (time, line, name) in enumerate(zip(times, values, names, strict=True))
    ]
    low, high = np.log10(log_limits(np.concatenate([np.ravel(line) for line in values])))
    axes = {"xaxis": {"title": {"text": "time (s)"}}, "yaxis": log_axis(title, low, high)}
    return {"data": lines, "layout": {**axes, "showlegend": True}}


def _both_known(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Two arrays where both have a value: a value that one run's log lacks counts as no difference."""
    known = np.isfinite(first) & np.isfinite(second)
    return first[known], second[known]


def _logged_ranges(trace: Trace, other: Trace) -> Floats:
    """The ranges (n, K) of the steps that two runs share, without those that either log lacks."""
    steps = min(len(trace.time), len(other.time))
    ranges = trace.ranges[:, :steps].copy()
    for one in (trace, other):
        if one.unlogged is not None:
            ranges[one.unlogged[:, :steps]] = np.nan
    return ranges


def _same(first: Floats, second: Floats) -> bool:
    return bool(np.array_equal(first, second, equal_nan=True))
