"""The figures of an experiment, as the plain data and layout that plotly.js draws."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape

from zenoh_cbef.analysis.figures import INK, MUTED, agent_style
from zenoh_cbef.experiment.results import CellSummary, Summary
from zenoh_cbef.pages.parts import Figure, Plot
from zenoh_cbef.plain import Json

Cells = Sequence[CellSummary]
Yardsticks = Sequence[tuple[str, str]]

# Metric, what it is called, and the metrics of the yardsticks that are drawn with it.
SHOWN = (
    ("position_rmse", "position RMSE (m)", (("centralized.position_rmse", "centralised"),)),
    ("ratio_to_centralized", "position RMSE / centralised", ()),
    ("velocity_rmse", "velocity RMSE (m/s)", (("centralized.velocity_rmse", "centralised"),)),
    ("disagreement", "disagreement (m)", ()),
    ("nees.average", "NEES", ()),
    ("links.missed", "share of messages lost or late", ()),
    ("bytes_per_step", "bytes per agent and step", ()),
)
_MOST_CURVES = 12
_CURVES = (("position_error", "position error (m)"), ("disagreement", "disagreement (m)"))


def figures_of(summary: Summary) -> list[Figure]:
    """All figures of a summary: every metric against the varied keys, and errors over time."""
    cells, varied = summary.cells, summary.varied
    figures = []
    for metric, title, yardsticks in SHOWN:
        if not varied or not any(metric in cell.metrics for cell in cells):
            continue
        caption = f"Medians over the seeds with {summary.level:.0%} bootstrap intervals."
        plot = _lines(cells, varied, metric, title, yardsticks)
        figures.append(Figure(_file(metric), f"{title} against {varied[0]}", caption, plot))
        if len(varied) == 2:
            caption = "Medians over the seeds."
            plot = _heat_map(cells, varied, metric, title)
            figures.append(Figure(f"{_file(metric)}-map", f"{title} over {' and '.join(varied)}", caption, plot))
    for name, title in _CURVES:
        if any(cell.curve for cell in cells):
            caption = "Median over the seeds at each step: how fast errors settle, and recover."
            shown = f", the first {_MOST_CURVES} cells" if len(cells) > _MOST_CURVES else ""
            figures.append(
                Figure(f"{_file(name)}-over-time", f"{title} over time{shown}", caption, _curves(cells, name, title))
            )
    return figures


def written_value(value: Json) -> str:
    """A varied value as words; a fault as its kind and its numbers."""
    if isinstance(value, Mapping):
        parts = [str(each) if key == "kind" else f"{key}={written_value(each)}" for key, each in value.items()]
        return " ".join(parts)
    if isinstance(value, list | tuple) and any(isinstance(one, Mapping) for one in value):
        return "; ".join(map(written_value, value))
    return value if isinstance(value, str) else json.dumps(value)


def short_names(varied: Sequence[str]) -> list[str]:
    """The last part of each varied key, or all of it where that is a number or not unique."""
    last = [key.rpartition(".")[2] for key in varied]
    alone = [last.count(name) == 1 and not name.isdecimal() for name in last]
    return [name if unique else key for key, name, unique in zip(varied, last, alone, strict=True)]


def _file(metric: str) -> str:
    return metric.replace(".", "-").replace("_", "-")


def _median(cell: CellSummary, metric: str) -> float | None:
    found = cell.metrics.get(metric)
    return None if found is None else found.median


def _numbers(values: Sequence[Json]) -> list[float]:
    """The values, where all are numbers; otherwise none."""
    found = [value for value in values if isinstance(value, int | float) and not isinstance(value, bool)]
    return found if len(found) == len(values) else []


def _axis(values: Sequence[Json], key: str) -> Plot:
    """Choose an axis: numbers to scale (logarithmic where they span more than two decades), the rest in order."""
    axis: Plot = {"title": {"text": escape(key)}}
    numbers = _numbers(values)
    if not numbers:
        return axis | {"type": "category"}
    return axis | {"type": "log" if min(numbers) > 0 and max(numbers) >= 100 * min(numbers) else "linear"}


def _places(values: Sequence[Json]) -> Sequence[float | str]:
    return _numbers(values) or [escape(written_value(value)) for value in values]


def _lines(cells: Cells, varied: Sequence[str], metric: str, title: str, yardsticks: Yardsticks) -> Plot:
    """One line per combination of the other keys against the first."""
    first, *others = varied
    groups: dict[str, list[CellSummary]] = {}
    for cell in cells:
        name = ", ".join(f"{key} = {written_value(cell.values[key])}" for key in others)
        groups.setdefault(name, []).append(cell)
    lines: list[Plot] = []
    for place, (name, members) in enumerate(groups.items()):
        colour, dash = agent_style(place)
        known = [cell for cell in members if metric in cell.metrics]
        found = [cell.metrics[metric] for cell in known]
        error = {
            "type": "data",
            "array": [one.high - one.median for one in found],
            "arrayminus": [one.median - one.low for one in found],
        }
        lines.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "name": escape(name) or "network",
                "x": _places([cell.values[first] for cell in known]),
                "y": [one.median for one in found],
                "error_y": error,
                "line": {"color": colour, "dash": dash},
            }
        )
        for yardstick, label in yardsticks:
            drawn: Plot = {"x": lines[-1]["x"], "y": [_median(cell, yardstick) for cell in known]}
            colour, role = (INK, "ink") if len(groups) == 1 else (MUTED, "muted")
            dashed = {"meta": role, "line": {"color": colour, "dash": "dash", "width": 1}}
            # Consensus does not change a centralised filter: one line is enough where its values are the same.
            if any(line["x"] == drawn["x"] and line["y"] == drawn["y"] for line in lines):
                continue
            lines.append({"type": "scatter", "mode": "lines", "name": f"{escape(name)} {label}", **drawn, **dashed})
    alone = [line for line in lines if "error_y" not in line]
    if len(alone) == 1:
        alone[0]["name"] = yardsticks[0][1]
    lines.sort(key=lambda line: "error_y" not in line)
    values = [cell.values[first] for cell in cells]
    return {"data": lines, "layout": _layout(_axis(values, first), title)}


def _heat_map(cells: Cells, varied: Sequence[str], metric: str, title: str) -> Plot:
    across, along = varied
    rows: dict[str, dict[str, float | None]] = {}
    for cell in cells:
        row = rows.setdefault(written_value(cell.values[along]), {})
        row[written_value(cell.values[across])] = _median(cell, metric)
    columns = list(dict.fromkeys(name for row in rows.values() for name in row))
    heat = {
        "type": "heatmap",
        "x": list(map(escape, columns)),
        "y": list(map(escape, rows)),
        "z": [[row.get(name) for name in columns] for row in rows.values()],
        "colorscale": "Viridis",
        "colorbar": {"title": {"text": title, "side": "right"}},
        "texttemplate": "%{z:.3g}",
    }
    layout = _layout({"title": {"text": escape(across)}, "type": "category"}, escape(along))
    layout["yaxis"]["type"] = "category"
    return {"data": [heat], "layout": layout}


def _curves(cells: Cells, name: str, title: str) -> Plot:
    lines = []
    drawn = [(cell, cell.curve) for cell in cells if cell.curve]
    for place, (cell, curve) in enumerate(drawn[:_MOST_CURVES]):
        colour, dash = agent_style(place)
        label = ", ".join(f"{key} = {written_value(value)}" for key, value in cell.values.items())
        shown = [value if value and value > 0.0 else None for value in getattr(curve, name)]
        line: Plot = {"type": "scatter", "mode": "lines", "name": escape(label) or "network"}
        line |= {"line": {"color": colour, "dash": dash, "width": 1.5}}
        lines.append(line | {"x": curve.time, "y": shown})
    layout = _layout({"title": {"text": "time (s)"}}, title)
    layout["yaxis"]["type"] = "log"
    return {"data": lines, "layout": layout}


def _layout(axis: Plot, title: str) -> Plot:
    # The colour of a ratio shows its distance from one, that of any other metric its distance from zero.
    return {
        "xaxis": axis,
        "yaxis": {"title": {"text": title}, "rangemode": "normal" if " / " in title else "tozero"},
    }
