"""The figures of an experiment, as the plain data and layout that plotly.js draws."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from zenoh_cbef.analysis.figures import INK, MUTED, agent_style, log_axis, log_limits
from zenoh_cbef.experiment.results import CellSummary, Summary
from zenoh_cbef.experiment.words import MEASURED, Measured
from zenoh_cbef.pages.parts import Figure, Plot
from zenoh_cbef.plain import Json
from zenoh_cbef.words import counted

Cells = Sequence[CellSummary]

_MOST_LINES = 8
"""More of them cannot be told apart: a map takes their place."""
_MOST_CURVES = 12
_SPAN, _SPAN_OF_RESULTS = 100.0, 30.0
"""From how many times the least value on the largest one gets a logarithmic scale."""
_CURVES = (
    ("position_error", "position error (m)", "How fast do errors settle, and recover?"),
    ("disagreement", "disagreement (m)", "How fast do the agents come to agree?"),
)


def figures_of(summary: Summary) -> list[Figure]:
    """All figures of a summary, one for each question: metrics against the varied keys, and errors over time."""
    cells, varied = summary.cells, summary.varied
    figures = []
    for one in MEASURED:
        if not varied or not any(one.metric in cell.metrics for cell in cells):
            continue
        over = " and ".join(summary.words[key] for key in varied)
        caption = f"{one.words} over {over}: medians over the seeds"
        if len({_row(cell, varied) for cell in cells}) > _MOST_LINES:
            plot = _heat_map(summary, one)
        else:
            caption += f" with {summary.level:.0%} bootstrap intervals"
            plot = _lines(summary, one)
        figures.append(Figure(_file(one.metric), one.question, f"{caption}.", plot))
    for name, title, question in _CURVES:
        if any(cell.curve for cell in cells):
            drawn = sum(cell.curve is not None for cell in cells)
            shown = f" Only the first {_MOST_CURVES} of {drawn} cells are drawn." if drawn > _MOST_CURVES else ""
            caption = f"{title} at each step: medians over the seeds.{shown}"
            plot = _curves(summary, name, title)
            figures.append(Figure(f"{_file(name)}-over-time", question, caption, plot))
    return figures


def cell_words(values: Mapping[str, Json], words: Mapping[str, str]) -> str:
    """The values of a cell: a text speaks for itself, a number needs the words of its key."""
    told = [one if isinstance(one, str) else f"{words[key]} {written_value(one)}" for key, one in values.items()]
    return ", ".join(told) or "all runs"


def written_value(value: Json) -> str:
    """A varied value as words; a fault as its kind and its numbers, no fault as "none"."""
    if value in ([], ()):
        return "none"
    if isinstance(value, Mapping):
        parts = [str(each) if key == "kind" else f"{key}={written_value(each)}" for key, each in value.items()]
        return " ".join(parts)
    if isinstance(value, list | tuple) and any(isinstance(one, Mapping) for one in value):
        return "; ".join(map(written_value, value))
    return value if isinstance(value, str) else json.dumps(value)


def _row(cell: CellSummary, varied: Sequence[str]) -> str:
    """The values of all keys but the first, which is the x axis: a line of a figure, or a row of a map."""
    return ", ".join(written_value(cell.values[key]) for key in varied[1:])


def _file(metric: str) -> str:
    return metric.replace(".", "-").replace("_", "-")


def _median(cell: CellSummary, metric: str) -> float | None:
    found = cell.metrics.get(metric)
    return None if found is None else found.median


def _numbers(values: Sequence[Json]) -> list[float]:
    """The values, where all are numbers; otherwise none."""
    found = [value for value in values if isinstance(value, int | float) and not isinstance(value, bool)]
    return found if len(found) == len(values) else []


def _scale(numbers: Sequence[float], most: float = _SPAN) -> str:
    """The scale on which numbers can be told apart: logarithmic where the largest is too many times the least."""
    return "log" if numbers and min(numbers) > 0 and max(numbers) >= most * min(numbers) else "linear"


def _axis(values: Sequence[Json], words: str) -> Plot:
    """Choose an axis: numbers to scale, the rest in order."""
    axis: Plot = {"title": {"text": escape(words)}}
    numbers = _numbers(values)
    return axis | ({"type": _scale(numbers)} if numbers else {"type": "category", "automargin": True})


def _places(values: Sequence[Json]) -> Sequence[float | str]:
    return _numbers(values) or list(map(escape, _names(values)))


def _names(values: Sequence[Json]) -> list[str]:
    """The values in words that fit below an axis: faults by their kinds alone, where these tell them apart."""
    whole, short = list(map(written_value, values)), list(map(_kinds, values))
    return short if len(set(short)) == len(set(whole)) else whole


def _kinds(value: Json) -> str:
    tables = [one for one in value if isinstance(one, Mapping)] if isinstance(value, list | tuple) else []
    return "; ".join(str(one.get("kind")) for one in tables) or written_value(value)


def _lines(summary: Summary, measured: Measured) -> Plot:
    """One line per combination of the other keys against the first; points where that is no number."""
    cells, metric, words, yardsticks = summary.cells, measured.metric, summary.words, measured.yardsticks
    first, *others = summary.varied
    line = "lines+" if _numbers([cell.values[first] for cell in cells]) else ""
    values = [cell.values[first] for cell in cells]
    places = dict(zip((cell.cell for cell in cells), _places(values), strict=True))
    groups: dict[str, list[CellSummary]] = {}
    for cell in cells:
        name = cell_words({key: cell.values[key] for key in others}, words) if others else ""
        groups.setdefault(name, []).append(cell)
    lines: list[Plot] = []
    for place, (name, members) in enumerate(groups.items()):
        colour, dash = agent_style(place)
        known = [cell for cell in members if metric in cell.metrics]
        found = [cell.metrics[metric] for cell in known]
        above, below = [one.high - one.median for one in found], [one.median - one.low for one in found]
        error = {"type": "data", "array": above, "arrayminus": below}
        lines.append(
            {
                "type": "scatter",
                "mode": f"{line}markers",
                "name": escape(name) or "network",
                "x": [places[cell.cell] for cell in known],
                "y": [one.median for one in found],
                "error_y": error,
                "line": {"color": colour, "dash": dash},
            }
        )
        for yardstick, label in yardsticks:
            drawn: Plot = {"x": lines[-1]["x"], "y": [_median(cell, yardstick) for cell in known]}
            dashed = {"line": {"color": colour, "dash": "dash", "width": 1}, "marker": {"symbol": "x"}}
            # Consensus does not change a centralised filter: one line is enough where its values are the same.
            if not any(drawn["y"]) or any(line["x"] == drawn["x"] and line["y"] == drawn["y"] for line in lines):
                continue
            named = {"mode": "lines" if line else "markers", "name": f"{escape(name)} {label}"}
            lines.append({"type": "scatter", **named, **drawn, **dashed})
    alone = [line for line in lines if "error_y" not in line]
    if len(alone) == 1:  # Several have the colours of the lines that they are beside.
        tone, role = (INK, "ink") if len(groups) == 1 else (MUTED, "muted")
        alone[0] |= {"name": yardsticks[0][1], "meta": role, "line": alone[0]["line"] | {"color": tone}}
    lines.sort(key=lambda line: "error_y" not in line)
    layout = _layout(_axis(values, words[first]), measured.words)
    shown = [value for line in lines for value in line["y"] if value is not None]
    layout["yaxis"]["type"] = _scale(shown, _SPAN_OF_RESULTS)
    return {"data": lines, "layout": layout if line else layout | {"scattermode": "group"}}


def _heat_map(summary: Summary, measured: Measured) -> Plot:
    cells, title = summary.cells, measured.words
    across, *along = summary.varied
    rows: dict[str, dict[str, float | None]] = {}
    for cell, name in zip(cells, _names([cell.values[across] for cell in cells]), strict=True):
        rows.setdefault(_row(cell, summary.varied), {})[name] = _median(cell, measured.metric)
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
    axis = {"title": {"text": escape(summary.words[across])}, "type": "category", "automargin": True}
    layout = _layout(axis, escape(", ".join(summary.words[key] for key in along)))
    layout["yaxis"] |= {"type": "category", "automargin": True}
    return {"data": [heat], "layout": layout}


def _curves(summary: Summary, name: str, title: str) -> Plot:
    lines = []
    drawn = [(cell, cell.curve) for cell in summary.cells if cell.curve]
    for place, (cell, curve) in enumerate(drawn[:_MOST_CURVES]):
        colour, dash = agent_style(place)
        label = cell_words(cell.values, summary.words) if cell.values else ""
        shown = [value if value and value > 0.0 else None for value in getattr(curve, name)]
        line: Plot = {"type": "scatter", "mode": "lines", "name": escape(label) or "network"}
        line |= {"line": {"color": colour, "dash": dash, "width": 1.5}}
        lines.append(line | {"x": curve.time, "y": shown})
    if (more := len(drawn) - _MOST_CURVES) > 0:
        unseen = {"type": "scatter", "mode": "lines", "line": {"color": "#00000000"}, "x": [None], "y": [None]}
        lines.append({**unseen, "name": f"{counted(more, 'more cell')} not drawn"})
    values = np.array([value for line in lines for value in line["y"] if value is not None], dtype=np.float64)
    low, high = np.log10(log_limits(values))
    return {
        "data": lines,
        "layout": {"xaxis": {"title": {"text": "time (s)"}}, "yaxis": log_axis(title, low, high)},
    }


def _layout(axis: Plot, title: str) -> Plot:
    # The colour of a ratio shows its distance from one, that of any other metric its distance from zero.
    return {
        "xaxis": axis,
        "yaxis": {"title": {"text": title}, "rangemode": "normal" if " / " in title else "tozero"},
    }
