"""The report's interactive plots, as the plain data and layout that plotly.js draws.

Nothing here needs plotly. `meta` names a theme colour that the page puts in, for light, dark and print.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence

import numpy as np

from zenoh_cbef.analysis.figures import (
    INK,
    MUTED,
    ROLES,
    Chart,
    Dash,
    Role,
    agent_names,
    agent_style,
    has_lone_points,
    log_axis,
    log_range,
    points_each,
    positive,
    thinned,
)
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.standing import begun, paths_by_stroke, paths_of
from zenoh_cbef.arrays import Floats
from zenoh_cbef.pages.parts import Plot
from zenoh_cbef.trace import Links

_LARGEST = float(np.finfo(np.float32).max)
_POINTS_OF_ALL = 3000
"""In a plot: with it a report of 24 agents is below three megabytes, most of them plotly.js."""
_META: dict[Role, Plot] = {"network": {"meta": "ink"}, "centralized": {"meta": "ink"}, "bound": {"meta": "muted"}}
_LOSS_COLOURS = ("#8b96a1", "#b99a58", "#e0a030", "#d97a2c", "#cc4a2c", "#9c1c3c")


def time_plot(chart: Chart, analysis: Analysis) -> Plot:
    """Draw a chart over time, with its band, the periods of faults, and where the scored window starts."""
    time, names = analysis.trace.time, agent_names(analysis)
    width, points, data = 1.0 if len(names) > 12 else 1.4, points_each(len(names), _POINTS_OF_ALL), []
    for agent, values in enumerate([] if chart.agents is None else chart.agents):
        data.append(series(time, values, points, agent_style(agent), width) | _owned(agent, names[agent]))
    for reference in chart.references:
        line = series(time, reference.values, points_each(1), ROLES[reference.role], 2.0)
        data.append(line | {"name": reference.name} | _META.get(reference.role, {}))
    end = float(time[-1])
    shapes, notes = _faults(analysis, end)
    if chart.band:
        shapes.append(_box("y", chart.band, "rgba(0, 158, 115, 0.16)"))
    if chart.scored and analysis.first:
        start = float(time[analysis.first])
        line = {"color": MUTED, "width": 1, "dash": "dot"}
        shapes.append({"type": "line", "x0": start, "x1": start, "y0": 0, "y1": 1, "yref": "paper", "line": line})
        notes.append(_note(start, 0.0, "scored from here", "bottom", 0))
    low, high = np.log10(log_range(chart))
    # Names of faults stand in the plot, at its top: one lane is about a twentieth of its height.
    lanes = max((1 - note["yshift"] // 14 for note in notes if note["y"]), default=0)
    axis = log_axis(chart.axis, low, high)
    layout = {
        "xaxis": {"title": {"text": "time (s)"}, "range": [0.0, end]},
        "yaxis": {**axis, "range": [low, high + 0.055 * lanes * (high - low)]},
        "shapes": shapes,
        "annotations": notes,
    }
    return {"data": data, "layout": layout}


def space_plot(analysis: Analysis) -> Plot:
    """Truth, estimates and agents in three dimensions."""
    axes = {
        f"{axis}axis": {"title": {"text": f"{axis} (m)"}, "range": limits}
        for axis, limits in zip("xyz", _limits(analysis), strict=True)
    }
    return {"data": _scene(analysis, 3), "layout": {"scene": {**axes, "aspectmode": "data"}}}


def top_plot(analysis: Analysis) -> Plot:
    """Truth, estimates and agents seen from above, both axes to one scale."""
    return {"data": _scene(analysis, 2), "layout": _map_axes(_limits(analysis)[:2])}


def network_plot(analysis: Analysis) -> Plot:
    """Every directed link, its width and colour by the share of messages that were lost or late."""
    links, names = analysis.trace.links, agent_names(analysis)
    places, real = _places(analysis.trace.positions)
    extent = float(np.ptp(places, axis=0).max()) or 1.0
    along = places[links.destination] - places[links.source]
    length = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    # Both directions of an edge run side by side, each on its right.
    aside = 0.008 * extent * np.stack([along[:, 1], -along[:, 0]], axis=1) / length
    start, end = places[links.source] + aside, places[links.destination] + aside
    nodes = {"text": [html.escape(name) for name in names], "marker": {"line": {"color": _colours(names)}}}
    nodes |= {"mode": "markers+text", "hoverinfo": "skip", "meta": "node"}
    margin = 0.1 * extent
    limits = np.stack([places.min(axis=0) - margin, places.max(axis=0) + margin], axis=1)
    layout = _map_axes(limits.tolist())
    layout["xaxis"]["visible"] = layout["yaxis"]["visible"] = real
    data = [*_link_lines(start, end, missed_share(links)), _arrows(start, end, links, names)]
    return {"data": [*data, _xy(places) | nodes], "layout": layout | {"showlegend": False}}


def missed_share(links: Links) -> Floats:
    """Share of each link's messages that were lost or late, (e,); 0 where none was sent."""
    return np.clip((links.sent - links.delivered) / np.maximum(links.sent, 1), 0.0, 1.0)


def _packed(values: Floats) -> dict[str, str]:
    """Numbers as plotly.js reads them fastest, and in a third of the space of decimals."""
    single = np.clip(values, -_LARGEST, _LARGEST).astype("<f4")
    return {"dtype": "f4", "bdata": base64.b64encode(single.tobytes()).decode("ascii")}


def _owned(agent: int, name: str) -> Plot:
    """Name an agent's line; the page's buttons switch it, not the plot's own legend."""
    return {"name": html.escape(f"agent {name}"), "legendgroup": f"agent-{agent}", "showlegend": False}


def series(time: Floats, values: Floats, points: int, style: tuple[str, Dash], width: float) -> Plot:
    """Draw positive values (K,) over time, thinned to about so many points; style: colour and dash."""
    shown = positive(values)
    kept = thinned(shown, points)
    return {
        "type": "scatter",
        "mode": "lines+markers" if has_lone_points(shown) else "lines",
        "marker": {"size": 3},
        "line": {"color": style[0], "dash": style[1], "width": width},
        "x": _packed(time[kept]),
        "y": _packed(shown[kept]),
        "hovertemplate": "%{x:.6~g} s: %{y:.4~g}<extra>%{fullData.name}</extra>",
    }


def _box(axis: str, span: tuple[float, float], colour: str) -> Plot:
    other = "x" if axis == "y" else "y"
    ends = {f"{axis}0": span[0], f"{axis}1": span[1], f"{other}0": 0, f"{other}1": 1, f"{other}ref": "paper"}
    return {"type": "rect", **ends, "fillcolor": colour, "line": {"width": 0}, "layer": "below"}


def _note(time: float, height: float, text: str, anchor: str, lane: int) -> Plot:
    place = {
        "x": time,
        "y": height,
        "yref": "paper",
        "xanchor": "left",
        "yanchor": anchor,
        "yshift": -14 * lane,
    }
    return place | {"text": text, "showarrow": False}


def _faults(analysis: Analysis, end: float) -> tuple[list[Plot], list[Plot]]:
    """Shade each period and name its faults; names that would meet go one lane down."""
    periods: dict[tuple[float, float], list[str]] = {}
    for fault in analysis.trace.scenario.fault:
        until = end if fault.until is None else min(fault.until, end)
        if fault.since < until:
            periods.setdefault((fault.since, until), []).append(fault.kind)
    shapes, notes, free = [], [], [0.0]
    for (since, until), kinds in sorted(periods.items()):
        shapes.append(_box("x", (since, until), "rgba(204, 120, 60, 0.11)"))
        text = " + ".join(dict.fromkeys(kinds))
        lane = next((lane for lane, taken in enumerate(free) if since >= taken), len(free))
        free[lane : lane + 1] = [since + end * 0.01 * (len(text) + 2)]
        notes.append(_note(since, 1.0, html.escape(text), "top", lane))
    return shapes, notes


def _map_axes(limits: Sequence[Sequence[float]]) -> Plot:
    across, along = ({"title": {"text": f"{axis} (m)"}, "range": pair} for axis, pair in zip("xy", limits, strict=True))
    return {"xaxis": across, "yaxis": along | {"scaleanchor": "x"}}


def _limits(analysis: Analysis) -> list[list[float]]:
    """Axis limits (3, 2): truth and agents, and estimates as far as they do not dwarf these."""
    trace = analysis.trace
    core = np.concatenate([trace.truth[:, :3], trace.positions.reshape(-1, 3)])
    core = core[np.isfinite(core).all(axis=1)]
    low, high = core.min(axis=0), core.max(axis=0)
    reach = 0.5 * float(np.max(high - low)) or 1.0
    estimates = paths_of(trace).reshape(-1, 3)
    estimates = estimates[np.isfinite(estimates).all(axis=1)]
    if len(estimates):
        low = np.minimum(low, np.maximum(np.quantile(estimates, 0.005, axis=0), low - reach))
        high = np.maximum(high, np.minimum(np.quantile(estimates, 0.995, axis=0), high + reach))
    margin = 0.06 * np.maximum(high - low, reach)
    limits: list[list[float]] = np.stack([low - margin, high + margin], axis=1).tolist()
    return limits


def _xy(points: Floats) -> Plot:
    coordinates = {axis: _packed(column) for axis, column in zip("xyz", points.T, strict=False)}
    return coordinates | {"type": "scatter3d" if points.shape[1] == 3 else "scatter"}


def _path(points: Floats, colour: str, dash: Dash, width: float) -> Plot:
    each = points_each(8, _POINTS_OF_ALL) // 3
    kept = np.unique(np.concatenate([thinned(column, each) for column in points.T]))
    digits = ", ".join(f"%{{{axis}:.2f}}" for axis in "xyz"[: points.shape[1]])
    line = {"color": colour, "dash": dash, "width": width * (1.5 if points.shape[1] == 3 else 1.0)}
    return _xy(points[kept]) | {"mode": "lines", "line": line, "hovertemplate": f"({digits}) m"}


def _scene(analysis: Analysis, axes: int) -> list[Plot]:
    """Estimates, truth and centralised filter, and the agents with the way they came."""
    trace, names = analysis.trace, agent_names(analysis)
    width, paths, plots = 1.0 if len(names) > 12 else 1.5, paths_of(trace), []
    for agent, (name, way) in enumerate(zip(names, trace.positions, strict=True)):
        colour, dash = agent_style(agent)
        for stroke, path in paths_by_stroke(trace, agent):
            plots.append(_path(path[:, :axes], colour, dash, width) | _owned(agent, name) | {"opacity": stroke})
        known = way[np.isfinite(way).all(axis=1)]
        if len(known) and np.ptp(known, axis=0).max() > 0.0:
            plots.append(_path(way[:, :axes], colour, "dot", 1.0) | _owned(agent, name))
    # Broad and pale, so that neither an estimate that lies on it nor one that buries it hides the other.
    truth = _path(trace.truth[:, :axes], MUTED, "solid", 6.0) | {"name": "truth", "meta": "muted", "opacity": 0.45}
    central = _path(analysis.centralized_states[begun(paths) :, :axes], INK, "dash", 1.5)
    known = [truth] if np.isfinite(trace.truth).all(axis=1).any() else []
    plots += [*known, central | {"name": "centralised filter", "meta": "ink"}]
    if analysis.smoothed is not None:
        best = _path(analysis.smoothed.path[:, :axes], INK, "solid", 1.5)
        plots.append(best | {"name": "smoothed, mean of the agents", "meta": "ink"})
    agents = {
        "mode": "markers+text" if axes == 2 or len(names) <= 12 else "markers",
        "name": "agents",
        "text": [html.escape(name) for name in names],
        "textposition": "top center",
        "marker": {"size": 5 if axes == 3 else 9, "symbol": "diamond", "color": _colours(names)},
        "hovertemplate": "agent %{text}<extra></extra>",
    }
    return [*plots, _xy(_last_known(trace.positions)[:, :axes]) | agents]


def _colours(names: list[str]) -> list[str]:
    return [agent_style(agent)[0] for agent in range(len(names))]


def _last_known(positions: Floats) -> Floats:
    last = positions.shape[1] - 1 - np.isfinite(positions[:, ::-1, 0]).argmax(axis=1)
    known: Floats = positions[np.arange(len(positions)), last]
    return known


def _places(positions: Floats) -> tuple[Floats, bool]:
    """Choose where to draw the agents, (n, 2), and say if they were there; in a circle if two would meet."""
    places, count = _last_known(positions)[:, :2], len(positions)
    apart = np.linalg.norm(places[:, None] - places, axis=2) + np.where(np.eye(count), np.inf, 0.0)
    if np.isfinite(places).all() and apart.min() > 0.055 * np.ptp(places, axis=0).max():
        return places, True
    angle = np.pi / 2.0 - 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=1), False


def _scale_end(share: Floats) -> float:
    """Choose where the colour scale ends: a round share, so that runs can be compared by eye."""
    return next(end for end in (0.05, 0.1, 0.25, 0.5, 1.0) if share.max(initial=0.0) <= end)


def _link_lines(start: Floats, end: Floats, share: Floats) -> list[Plot]:
    """Draw links in classes of equal width and colour: a dense graph is still a handful of lines."""
    classes, crowd = len(_LOSS_COLOURS) - 1, min(1.0, 60.0 / max(len(share), 1))
    level = np.rint(classes * share / _scale_end(share)).astype(int)
    plots = []
    for each in np.unique(level).tolist():
        chosen = level == each
        gap = np.full((int(chosen.sum()), 2), np.nan)
        points = np.stack([start[chosen], end[chosen], gap], axis=1).reshape(-1, 2)
        line = {"width": 0.5 + crowd * (0.5 + 0.45 * each), "color": _LOSS_COLOURS[each]}
        plots.append(_xy(points) | {"mode": "lines", "line": line, "hoverinfo": "skip"})
    return plots


def _arrows(start: Floats, end: Floats, links: Links, names: list[str]) -> Plot:
    """Put an arrow on each link, nearer to where it leads, that tells the link's counts."""
    share = missed_share(links)
    heading = np.degrees(np.arctan2(end[:, 0] - start[:, 0], end[:, 1] - start[:, 1]))
    columns = (links.source, links.destination, links.sent, links.delivered, links.lost, links.late)
    texts = [
        f"{html.escape(names[source])} → {html.escape(names[destination])}<br>{sent} sent, {came} delivered"
        f"<br>{lost} lost, {late} late" + (f"<br>{1e3 * wait:.3g} ms from sending to use" if wait > 0.0 else "")
        for (source, destination, sent, came, lost, late), wait in zip(
            np.stack(columns, axis=1).tolist(), links.latency.tolist(), strict=True
        )
    ]
    scale = [[place / (len(_LOSS_COLOURS) - 1), colour] for place, colour in enumerate(_LOSS_COLOURS)]
    colours = {
        "color": _packed(100.0 * share),
        "colorscale": scale,
        "cmin": 0.0,
        "cmax": 100.0 * _scale_end(share),
    }
    shape = {"angle": _packed(heading), "size": 11 if len(share) <= 60 else 6, "showscale": bool(share.any())}
    told = {"mode": "markers", "text": texts, "hovertemplate": "%{text}<extra></extra>", "meta": "arrow"}
    return _xy(start + 0.66 * (end - start)) | told | {"marker": colours | shape}
