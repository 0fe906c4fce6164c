"""Runs side by side: one row of numbers each, and their error curves in one picture."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.analysis.figures import agent_style, positive
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.mixing import configured_scheme
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import from_extra
from zenoh_cbef.trace import Trace

Floats = NDArray[np.float64]

COLUMNS = (
    "position_rmse",
    "velocity_rmse",
    "ratio_to_centralized",
    "msee.average",
    "nees.average",
    "nis.average",
    "disagreement",
    "bytes_per_step",
    "missed",
)


def row(analysis: Analysis, name: str) -> dict[str, Any]:
    """One run's row: what ran, and its metrics by their dotted names; None where it has none.

    missed: share of the messages between agents that were lost or late.
    """
    plan, links = analysis.trace.plan, analysis.trace.links
    sent = int(links.sent.sum())
    metrics = {**analysis.metrics, "missed": (sent - int(links.delivered.sum())) / sent if sent else None}
    values = {column: pick(metrics, column) for column in COLUMNS}
    return {
        "run": name,
        **{key: metrics[key] for key in ("filter", "agents", "steps", "seed")},
        "consensus": configured_scheme(plan),
        "rounds": plan.rounds,
        "complete": metrics["complete"],
        **{column: value if np.isfinite(value) else None for column, value in values.items()},
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


def _page(html: str) -> str:
    """The page as wide as the screen also on a phone."""
    return html.replace("<head>", '<head><meta name="viewport" content="width=device-width, initial-scale=1">', 1)


def write_picture(analyses: Sequence[Analysis], names: Sequence[str], path: Path) -> None:
    """Write the average MSEE and the position error of all runs over time, as one HTML file that opens offline.

    Raises UserError where plotly is not installed, or the file cannot be written.
    """
    plotly = from_extra("plotly.io", "the picture")
    try:
        path.write_text(
            _page(plotly.to_html(_figure(analyses, names), include_plotlyjs=True, config={"responsive": True})),
            encoding="utf-8",
        )
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}; choose another --output") from None


def _figure(analyses: Sequence[Analysis], names: Sequence[str]) -> dict[str, Any]:
    lines = []
    for place, (one, name) in enumerate(zip(analyses, names, strict=True)):
        colour, dash = agent_style(place)
        present = np.isfinite(one.position_error)
        squares = np.where(present, one.position_error, 0.0) ** 2
        error = np.sqrt(squares.sum(axis=0) / np.maximum(present.sum(axis=0), 1))
        style = {"name": escape(name), "legendgroup": str(place), "line": {"color": colour, "dash": dash, "width": 1.6}}
        for axes, values in (("", one.msee_average), ("2", error)):
            shown = [value if np.isfinite(value) else None for value in positive(values).tolist()]
            line = {"x": one.trace.time.tolist(), "y": shown, "xaxis": f"x{axes}", "yaxis": f"y{axes}"}
            lines.append({"type": "scatter", "mode": "lines", "showlegend": not axes, **style, **line})
    layout = {
        "title": {"text": "Runs compared"},
        "template": "plotly_white",
        "height": 820,
        "hovermode": "x unified",
        "xaxis": {"anchor": "y", "matches": "x2"},
        "yaxis": {"domain": [0.55, 1.0], "type": "log", "title": {"text": "average MSEE (m² + m²/s²)"}},
        "xaxis2": {"anchor": "y2", "title": {"text": "time (s)"}},
        "yaxis2": {"domain": [0.0, 0.45], "type": "log", "title": {"text": "position error, RMS of agents (m)"}},
    }
    return {"data": lines, "layout": layout}


def _both_known(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Two arrays where both have a value: what one run's log lacks is no difference."""
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


def _same(first: Any, second: Any) -> bool:
    return bool(np.array_equal(first, second, equal_nan=True))
