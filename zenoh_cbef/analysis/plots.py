"""The report's interactive plots, as the plain data and layout that plotly.js draws.

Nothing here needs plotly. `meta` names a theme colour that the page puts in, for light, dark and print.
"""

from __future__ import annotations

import base64
import html
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.analysis.figures import (
    INK,
    MUTED,
    ROLES,
    Chart,
    agent_names,
    agent_style,
    has_lone_points,
    log_range,
    points_each,
    positive,
    thinned,
)
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.trace import Links

Floats = NDArray[np.float64]
Plot = dict[str, Any]

_LARGEST = float(np.finfo(np.float32).max)
_LOSS_COLOURS = [[0.0, "#8b96a1"], [0.35, "#e0a030"], [0.7, "#d1582a"], [1.0, "#9c1c3c"]]
_LOSS_CLASSES = 6


@dataclass(frozen=True)
class _Path:
    """A line through space: points (K, 3). group: what the page's agent buttons switch."""

    name: str
    points: Floats
    colour: str
    dash: str
    width: float
    meta: str = ""
    group: str = ""


def time_plot(chart: Chart, analysis: Analysis) -> Plot:
    """A chart over time: agents, references, band, fault periods, and where the scored window starts."""
    time = analysis.trace.time
    data, dense = [], chart.agents is not None and len(chart.agents) > 12
    for agent, values in enumerate([] if chart.agents is None else chart.agents):
        colour, dash = agent_style(agent)
        line = {"color": colour, "dash": dash, "width": 1.0 if dense else 1.4}
        name = html.escape(f"agent {agent_names(analysis)[agent]}")
        points = points_each(len(analysis.trace.estimates))
        data.append(
            _series(time, values, points)
            | {"name": name, "line": line, "legendgroup": f"agent-{agent}", "showlegend": False}
        )
    for reference in chart.references:
        colour, dash = ROLES[reference.role]
        line = {"color": colour, "dash": dash, "width": 2.0}
        meta = "ink" if colour == INK else "muted"
        data.append(_series(time, reference.values, 2000) | {"name": reference.name, "line": line, "meta": meta})
    end = float(time[-1])
    shapes, notes = _faults(analysis, end)
    low, high = log_range(chart)
    if chart.band:
        shapes.append(_box("y", chart.band, "rgba(0, 158, 115, 0.14)"))
    if chart.scored and analysis.first:
        start = float(time[analysis.first])
        line = {"color": MUTED, "width": 1, "dash": "dot"}
        shapes.append({"type": "line", "x0": start, "x1": start, "y0": 0, "y1": 1, "yref": "paper", "line": line})
        notes.append(_note(start, 0.0, "scored from here", "bottom"))
    room = 0.07 * np.log10(high / low) * (1 + max((note["yshift"] // -14 for note in notes), default=0))
    limits = [float(np.log10(low)), float(np.log10(high) + room)]
    return {
        "data": data,
        "layout": {
            "xaxis": {"title": {"text": "time (s)"}, "range": [0.0, end]},
            "yaxis": {
                "title": {"text": chart.axis},
                "type": "log",
                "range": limits,
                "exponentformat": "power",
                "dtick": 1 if high / low > 300 else "D2",
            },
            "shapes": shapes,
            "annotations": notes,
        },
    }


def space_plot(analysis: Analysis) -> Plot:
    """Truth, estimates and agents in three dimensions."""
    axes = {
        f"{axis}axis": {"title": {"text": f"{axis} (m)"}, "range": limits}
        for axis, limits in zip("xyz", _limits(analysis), strict=True)
    }
    data = [_drawn(path, 3) for path in _paths(analysis)] + _agents(analysis, 3)
    return {"data": data, "layout": {"scene": {**axes, "aspectmode": "data"}}}


def top_plot(analysis: Analysis) -> Plot:
    """Truth, estimates and agents seen from above, both axes to one scale."""
    across, along, _ = _limits(analysis)
    data = [_drawn(path, 2) for path in _paths(analysis)] + _agents(analysis, 2)
    layout = {
        "xaxis": {"title": {"text": "x (m)"}, "range": across},
        "yaxis": {"title": {"text": "y (m)"}, "range": along, "scaleanchor": "x"},
    }
    return {"data": data, "layout": layout}


def network_plot(analysis: Analysis) -> Plot:
    """Every directed link, its width and colour by the share of messages that were lost or late."""
    links, names = analysis.trace.links, agent_names(analysis)
    places, real = _places(analysis)
    extent = float(np.ptp(places, axis=0).max()) or 1.0
    along = places[links.destination] - places[links.source]
    length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    # Both directions of an edge run side by side, each on its right.
    aside = 0.008 * extent * np.stack([along[:, 1], -along[:, 0]], axis=1) / length
    start, end = places[links.source] + aside, places[links.destination] + aside
    share = missed_share(links)
    most = float(share.max(initial=0.0))
    data = _link_lines(start, end, share, most)
    data.append(_arrows(start, end, share, most, _link_texts(links, share, names)))
    data.append(
        _xy(places, 2)
        | {
            "type": "scatter",
            "mode": "markers+text",
            "text": [html.escape(name) for name in names],
            "textfont": {"size": 11},
            "hoverinfo": "skip",
            "meta": "node",
            "marker": {
                "size": 24,
                "color": "#ffffff",
                "line": {"color": [agent_style(agent)[0] for agent in range(len(names))], "width": 3},
            },
        }
    )
    margin = 0.1 * extent
    axes = {
        f"{axis}axis": {
            "range": [float(values.min() - margin), float(values.max() + margin)],
            "visible": real,
            "title": {"text": f"{axis} (m)"},
        }
        for axis, values in zip("xy", places.T, strict=True)
    }
    axes["yaxis"]["scaleanchor"] = "x"
    return {"data": data, "layout": {**axes, "showlegend": False, "hovermode": "closest"}}


def missed_share(links: Links) -> Floats:
    """Share of each link's messages that were lost or late, (e,); 0 where none was sent."""
    return np.clip((links.sent - links.delivered) / np.maximum(links.sent, 1), 0.0, 1.0)


def _packed(values: Floats) -> dict[str, str]:
    """Numbers as plotly.js reads them fastest, and in a third of the space of decimals."""
    single = np.clip(values, -_LARGEST, _LARGEST).astype("<f4")
    return {"dtype": "f4", "bdata": base64.b64encode(single.tobytes()).decode("ascii")}


def _series(time: Floats, values: Floats, points: int) -> Plot:
    shown = positive(values)
    kept = thinned(shown, points)
    lone = has_lone_points(shown)
    return {
        "type": "scatter",
        "mode": "lines+markers" if lone else "lines",
        "marker": {"size": 3},
        "x": _packed(time[kept]),
        "y": _packed(shown[kept]),
        "hovertemplate": "%{x:.6~g} s: %{y:.4~g}<extra>%{fullData.name}</extra>",
    }


def _box(axis: str, span: tuple[float, float], colour: str) -> Plot:
    other = "x" if axis == "y" else "y"
    ends = {f"{axis}0": span[0], f"{axis}1": span[1], f"{other}0": 0, f"{other}1": 1, f"{other}ref": "paper"}
    return {"type": "rect", **ends, "fillcolor": colour, "line": {"width": 0}, "layer": "below"}


def _note(time: float, height: float, text: str, anchor: str, lane: int = 0) -> Plot:
    return {
        "x": time,
        "y": height,
        "yref": "paper",
        "text": text,
        "xanchor": "left",
        "yanchor": anchor,
        "yshift": -14 * lane,
        "showarrow": False,
        "font": {"size": 11, "color": MUTED},
        "meta": "muted",
    }


def _faults(analysis: Analysis, end: float) -> tuple[list[Plot], list[Plot]]:
    """A shaded box for each period, named by its faults; names that would meet go one lane down."""
    periods: dict[tuple[float, float], list[str]] = {}
    for fault in analysis.trace.scenario.fault:
        until = end if fault.until is None else min(fault.until, end)
        if fault.since < until:
            periods.setdefault((fault.since, until), []).append(fault.kind)
    shapes, notes, free = [], [], [0.0]
    for (since, until), kinds in sorted(periods.items()):
        shapes.append(_box("x", (since, until), "rgba(204, 120, 60, 0.11)"))
        text = " + ".join(dict.fromkeys(kinds))
        lane = next((lane for lane, until_there in enumerate(free) if since >= until_there), len(free))
        free[lane:] = [since + end * 0.009 * (len(text) + 2), *free[lane + 1 :]]
        notes.append(_note(since, 1.0, html.escape(text), "top", lane))
    return shapes, notes


def _paths(analysis: Analysis) -> list[_Path]:
    trace, names = analysis.trace, agent_names(analysis)
    thin = 1.0 if len(names) > 12 else 1.5
    estimates = [
        _Path(f"agent {name}'s estimate", trace.estimates[agent, :, :3], *agent_style(agent), thin, "", f"agent-{agent}")
        for agent, name in enumerate(names)
    ]
    return [
        *estimates,
        _Path("truth", trace.truth[:, :3], INK, "solid", 3.0, "ink"),
        _Path("centralised filter", analysis.centralized_states[:, :3], INK, "dash", 2.0, "ink"),
    ]


def _drawn(path: _Path, axes: int) -> Plot:
    points = points_each(1) // 3
    kept = np.unique(np.concatenate([thinned(column, points) for column in path.points.T]))
    return _xy(path.points[kept], axes) | {
        "type": "scatter3d" if axes == 3 else "scatter",
        "mode": "lines",
        "name": html.escape(path.name),
        "line": {"color": path.colour, "dash": path.dash, "width": path.width * (1.5 if axes == 3 else 1.0)},
        "meta": path.meta,
        "legendgroup": path.group,
        "showlegend": not path.group,
        "hovertemplate": "(%{x:.2f}, %{y:.2f}" + (", %{z:.2f}" if axes == 3 else "") + ") m",
    }


def _xy(points: Floats, axes: int) -> Plot:
    return {axis: _packed(points[:, column]) for column, axis in enumerate("xyz"[:axes])}


def _agents(analysis: Analysis, axes: int) -> list[Plot]:
    """Where the agents were at the end, and the way they came if they moved."""
    positions, names = analysis.trace.positions, agent_names(analysis)
    kind = "scatter3d" if axes == 3 else "scatter"
    plots: list[Plot] = []
    for agent, way in enumerate(positions):
        colour, _ = agent_style(agent)
        if np.nanmax(np.ptp(way, axis=0), initial=0.0) > 0.0:
            path = _Path(f"agent {names[agent]}'s way", way, colour, "dot", 1.0, "", f"agent-{agent}")
            plots.append(_drawn(path, axes))
    marker = {
        "size": 5 if axes == 3 else 10,
        "symbol": "diamond",
        "color": [agent_style(agent)[0] for agent in range(len(names))],
    }
    plots.append(
        _xy(_last_known(positions), axes)
        | {
            "type": kind,
            "mode": "markers+text",
            "name": "agents",
            "text": [html.escape(name) for name in names],
            "textposition": "top center",
            "marker": marker,
            "meta": "agents",
            "hovertemplate": "agent %{text}<extra></extra>",
        }
    )
    return plots
