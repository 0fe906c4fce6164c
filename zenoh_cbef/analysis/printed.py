"""Figures on paper: what pages draw with plotly.js, as matplotlib draws it, one column wide."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from zenoh_cbef.analysis.categories import height_of_map, name_categories, side_by_side
from zenoh_cbef.analysis.figures import INK, MUTED
from zenoh_cbef.analysis.legends import legend_below
from zenoh_cbef.analysis.plot_values import numbers_of, rgba_of, values_of
from zenoh_cbef.arrays import Floats
from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import from_extra
from zenoh_cbef.pages.parts import Plot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

_WHAT = "the folder of figures"
_HEIGHT = 2.6 / 3.5
_LEGEND = 0.5
"""Inches of a legend that needs no more height."""
_MOST_NAMED = 8
_MOST_ARROWS = 400
_POINTS = 0.6
"""Points on paper for a pixel of the page."""
_DASHES = {"solid": "-", "dash": (0, (4, 1.6)), "dot": (0, (1, 1.2)), "dashdot": "-."}
_MARKERS = {"diamond": "D", "x": "x", "triangle-up": "^", "square": "s"}
_COLUMN: dict[str, float | str] = {
    "font.size": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 6.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.linewidth": 0.4,
    "grid.color": "#d5d9dd",
    # Without these two the same run would give other bytes each time.
    "svg.hashsalt": "zenoh-cbef",
    "svg.fonttype": "path",
}


@dataclass(frozen=True)
class Style:
    """How figures look on paper. width, height: inches.

    Without a height it is three quarters of the width, and more where a map or a legend has many rows. sheets: styles
    of matplotlib, by name or file, over the usual one. labels: other words for axes and legends. met: the words that
    the figures drawn so far have of their own.
    """

    width: float = 3.5
    height: float | None = None
    sheets: Sequence[str] = ()
    labels: Mapping[str, str] = field(default_factory=dict)
    met: set[str] = field(default_factory=set, compare=False)

    def word(self, text: str) -> str:
        """A label as the reader is to see it; two dollar signs in it would be read as a formula."""
        plain = html.unescape(text).replace("<br>", "\n")
        self.met.add(plain)
        return self.labels.get(plain, plain).replace("$", r"\$") if plain not in self.labels else self.labels[plain]


PLAIN = Style()


def drawn(plot: Plot, style: Style = PLAIN) -> Figure:
    """Draw a figure's data and layout. Raises UserError for a style sheet that there is not, or without matplotlib."""
    mpl, sheets = from_extra("matplotlib", _WHAT), from_extra("matplotlib.style", _WHAT)
    with mpl.rc_context(_COLUMN):
        try:
            sheets.use(list(style.sheets))
        except (OSError, ValueError) as error:
            raise UserError(f"no style of matplotlib can be had: {str(error).splitlines()[0]}; name another") from None
        size = style.width, style.height or max(style.width * _HEIGHT, height_of_map(plot))
        figure: Figure = import_module("zenoh_cbef.analysis.picture").Picture(figsize=size, layout="constrained")
        solid = any(one["type"] == "scatter3d" for one in plot["data"])
        axes: Axes = _solid(figure, plot, style) if solid else _flat(figure, plot, style)
        _beside(axes, plot["layout"], style)
        _limits(axes, plot["layout"])
        _legend(figure, axes, plot, style)
    return figure


def _flat(figure: Figure, plot: Plot, style: Style) -> Axes:
    axes = figure.add_subplot()
    _frame(axes, plot["layout"], style)
    for one in side_by_side(plot):
        (_heat if one["type"] == "heatmap" else _line)(axes, one, style)
    name_categories(axes, plot, style.width, style.word)
    return axes


def _solid(figure: Figure, plot: Plot, style: Style) -> Axes3D:
    axes: Axes3D = figure.add_subplot(projection="3d")
    _frame(axes, plot["layout"]["scene"], style)
    axes.set_zlabel(style.word(plot["layout"]["scene"]["zaxis"]["title"]["text"]))
    for one in plot["data"]:
        _solid_line(axes, one, style)
    return axes


def _frame(axes: Axes, layout: Plot, style: Style) -> None:
    """Scales, titles and the grid."""
    for name in "xy":
        axis = layout.get(f"{name}axis", {})
        axes.set(**{f"{name}label": style.word(axis.get("title", {}).get("text", ""))})
        if axis.get("type") == "log":
            axes.set(**{f"{name}scale": "log"})
    axes.grid(visible=True)
    axes.set_axisbelow(True)


def _limits(axes: Axes, layout: Plot) -> None:
    for name in "xyz":
        axis = layout.get("scene", layout).get(f"{name}axis", {})
        if "range" in axis:
            ends = np.array(axis["range"], dtype=np.float64)
            axes.set(**{f"{name}lim": (10.0**ends if axis.get("type") == "log" else ends).tolist()})
        elif axis.get("rangemode") == "tozero" and axis.get("type") not in {"log", "category"}:
            axes.set(**{f"{name}lim": (min(0.0, axes.get_ylim()[0]), None)})
        if "tickvals" in axis and name == "y":
            axes.set_yticks(axis["tickvals"], axis["ticktext"])
        if axis.get("visible") is False:
            axes.axis("off")
        if axis.get("scaleanchor"):
            axes.set_aspect("equal", adjustable="box")


def _colour(one: Plot) -> str:
    told: str = one.get("line", {}).get("color") or one.get("marker", {}).get("color")
    return {"ink": INK, "muted": MUTED}.get(one.get("meta", ""), told) or INK


def _line(axes: Axes, one: Plot, style: Style) -> None:
    """A line, points, or names at points."""
    x, y = values_of(one["x"]), values_of(one["y"])
    mode, line, marker = one.get("mode", "lines"), one.get("line", {}), one.get("marker", {})
    if one.get("meta") == "arrow":
        _arrows(axes, marker, numbers_of(one["x"]), numbers_of(one["y"]))
        return
    name = style.word(one["name"]) if _is_named(one) else "_"
    if "lines" in mode:
        dash, width = _DASHES[line.get("dash", "solid")], line.get("width", 2.0) * _POINTS
        look: Plot = {"color": _colour(one), "linewidth": width, "linestyle": dash, "alpha": one.get("opacity")}
        axes.plot(x, y, marker="." if "markers" in mode else "", markersize=2.5, label=name, **look)
    elif "markers" in mode:
        colours = _colours(marker, _colour(one))
        axes.scatter(x, y, s=_area(marker), c=colours, marker=_symbol(marker), label=name, zorder=3)
    if error := one.get("error_y"):
        reach = np.array([error["arrayminus"], error["array"]], dtype=np.float64)
        axes.errorbar(x, y, yerr=reach, fmt="none", ecolor=_colour(one), elinewidth=0.6, capsize=1.5)
    if "text" in mode:
        _names(axes, one, style)


def _names(axes: Axes, one: Plot, style: Style) -> None:
    """Names beside or above their markers, whole also at the edge of a plot."""
    away, above = 0.5 * _area(one.get("marker", {})) ** 0.5 + 1.5, one.get("textposition") == "top center"
    place: Plot = {"xytext": (0.0, away), "ha": "center"} if above else {"xytext": (away, 0.0), "va": "center"}
    for x, y, text in zip(values_of(one["x"]), values_of(one["y"]), one["text"], strict=True):
        axes.annotate(style.word(text), (x, y), textcoords="offset points", fontsize="x-small", zorder=4, **place)


def _solid_line(axes: Axes3D, one: Plot, style: Style) -> None:
    """The same in three dimensions."""
    x, y, z = (numbers_of(one[axis]) for axis in "xyz")
    mode, line, marker = one.get("mode", "lines"), one.get("line", {}), one.get("marker", {})
    name = style.word(one["name"]) if _is_named(one) else "_"
    if "lines" in mode:
        dash, width = _DASHES[line.get("dash", "solid")], line.get("width", 2.0) * _POINTS
        axes.plot(x, y, z, color=_colour(one), linewidth=width, linestyle=dash, alpha=one.get("opacity"), label=name)
    elif "markers" in mode:
        axes.scatter(x, y, z, s=_area(marker), c=_colours(marker), marker=_symbol(marker), label=name)
    for *place, text in zip(x, y, z, one["text"], strict=True) if "text" in mode else ():
        across, along, up = map(float, place)
        axes.text(across, along, up, f" {style.word(text)}", fontsize="x-small")


def _area(marker: Plot) -> float:
    return float((marker.get("size", 6) * _POINTS) ** 2)


def _colours(marker: Plot, otherwise: str = INK) -> list[str] | str:
    found: list[str] | str = marker.get("color") or marker.get("line", {}).get("color") or otherwise
    return found


def _symbol(marker: Plot) -> str:
    return _MARKERS.get(marker.get("symbol", ""), "o")


def _arrows(axes: Axes, marker: Plot, across: Floats, along: Floats) -> None:
    """A head on each link, its colour by the share of messages that were lost or late."""
    shares, angles = numbers_of(marker["color"]), numbers_of(marker["angle"])
    if len(shares) > _MOST_ARROWS:
        return
    colours = from_extra("matplotlib.colors", _WHAT)
    scale = colours.LinearSegmentedColormap.from_list("share", [tuple(pair) for pair in marker["colorscale"]])
    norm = colours.Normalize(marker["cmin"], marker["cmax"])
    shape = from_extra("matplotlib.markers", _WHAT).MarkerStyle
    painted = None
    for x, y, share, angle in zip(across, along, shares, angles, strict=True):
        head = shape("^").rotated(deg=-float(angle))
        painted = axes.scatter(x, y, s=16, c=[share], cmap=scale, norm=norm, marker=head, linewidths=0, zorder=2.5)
    if painted is not None and marker.get("showscale"):
        bar = axes.figure.colorbar(painted, ax=axes, shrink=0.7)
        bar.set_label("lost or late (%)")


def _heat(axes: Axes, one: Plot, style: Style) -> None:
    """A field of colours with a number in each cell."""
    across, along, values = values_of(one["x"]), values_of(one["y"]), np.array([values_of(row) for row in one["z"]])
    painted = axes.imshow(values, cmap="viridis", aspect="auto", origin="lower")
    axes.grid(visible=False)
    axes.set_xticks(range(len(across)), [style.word(str(each)) for each in across])
    axes.set_yticks(range(len(along)), [style.word(str(each)) for each in along])
    if "texttemplate" in one:
        light = float(np.nanmean([np.nanmin(values), np.nanmax(values)])) if np.isfinite(values).any() else 0.0
        for (row, column), value in np.ndenumerate(values):
            if np.isfinite(value):
                ink = "white" if value < light else "black"
                axes.text(column, row, f"{value:.3g}", ha="center", va="center", color=ink, fontsize="x-small")
    bar = axes.figure.colorbar(painted, ax=axes)
    bar.set_label(style.word(one.get("colorbar", {}).get("title", {}).get("text", "")))


def _beside(axes: Axes, layout: Plot, style: Style) -> None:
    """Periods, bands and lines behind the data, and what is written in the figure."""
    for shape in layout.get("shapes", ()):
        paper = "x" if shape.get("xref") == "paper" else "y" if shape.get("yref") == "paper" else ""
        if shape["type"] == "line" and paper == "y":
            axes.axvline(shape["x0"], color=shape["line"]["color"], linestyle=_DASHES["dot"], linewidth=0.7)
        elif shape["type"] == "rect" and paper:
            other = "x" if paper == "y" else "y"
            span = axes.axvspan if other == "x" else axes.axhspan
            span(shape[f"{other}0"], shape[f"{other}1"], color=rgba_of(shape["fillcolor"]), linewidth=0, zorder=0)
    for note in layout.get("annotations", ()):
        if note.get("yref") == "paper" and isinstance(note["x"], int | float):
            axes.annotate(
                style.word(note["text"]),
                (note["x"], note["y"]),
                xycoords=axes.get_xaxis_transform(),
                xytext=(1.5, note.get("yshift", 0) * _POINTS + (-1.0 if note["y"] else 1.0)),
                textcoords="offset points",
                ha=note.get("xanchor", "left"),
                va=note.get("yanchor", "top"),
                fontsize="x-small",
                color=MUTED,
            )


def _is_named(one: Plot) -> bool:
    return bool(one.get("name")) and one.get("showlegend") is not False


def _legend(figure: Figure, axes: Axes, plot: Plot, style: Style) -> None:
    """Name lines below the figure; those of agents by one entry where they are many."""
    if not any(np.isfinite(np.asarray(line.get_ydata(), dtype=np.float64)).any() for line in axes.lines) and not (
        axes.images or axes.collections
    ):
        axes.text(0.5, 0.5, "no values", transform=axes.transAxes, ha="center", va="center", color=MUTED)
    groups: dict[str, Plot] = {}
    for one in plot["data"]:
        if one.get("legendgroup") and "lines" in one.get("mode", ""):
            groups.setdefault(one["legendgroup"], one)
    line = from_extra("matplotlib.lines", _WHAT).Line2D
    handles = [
        line([], [], color=_colour(one), linestyle=_DASHES[one["line"].get("dash", "solid")], linewidth=0.8)
        for one in groups.values()
    ]
    names = [style.word(one["name"]) for one in groups.values()]
    if len(names) > _MOST_NAMED:
        handles, names = handles[:1], [f"{len(names)} agents"]
    others, labels = axes.get_legend_handles_labels()
    if plot["layout"].get("showlegend") is not False and (names or labels):
        legend_below(figure, [*handles, *others], [*names, *labels])
        tall = figure.legends[-1].get_window_extent().height / figure.dpi - _LEGEND
        if style.height is None and tall > 0.0:
            figure.set_figheight(figure.get_figheight() + tall)
