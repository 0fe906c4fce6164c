"""Axes of categories on paper: names that lean where they are long, points side by side, maps with room for rows."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from zenoh_cbef.pages.parts import Plot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ROW, _BESIDE, _CHARACTER = 0.18, 0.9, 0.06
"""Inches: a row of a map, what stands above and below the rows, and a character of a category."""
_APART, _ROOM = 0.12, 0.7
"""How far points of one category are apart, and all of them at most; categories are apart by one."""


def height_of_map(plot: Plot) -> float:
    """What a map needs for its rows, inches; 0 for other figures."""
    rows = [len(one["y"]) for one in plot["data"] if one["type"] == "heatmap"]
    return _ROW * max(rows) + _BESIDE if rows else 0.0


def side_by_side(plot: Plot) -> list[Plot]:
    """The lines of a figure; where they group their points, those of one category stand side by side."""
    lines: list[Plot] = plot["data"]
    if plot["layout"].get("scattermode") != "group":
        return lines
    places = {name: place for place, name in enumerate(_names(plot))}
    step = min(_APART, _ROOM / len(lines))
    return [
        {**one, "x": [places[name] + step * (number - (len(lines) - 1) / 2) for name in one["x"]]}
        for number, one in enumerate(lines)
    ]


def name_categories(axes: Axes, plot: Plot, width: float, word: Callable[[str], str]) -> None:
    """Name the categories of an axis; long names lean, as they would cover one another.

    width: of the figure, inches. word: a name as the reader is to see it.
    """
    if plot["layout"].get("xaxis", {}).get("type") != "category":
        return
    names = [word(name) for name in _names(plot)]
    axes.set_xticks(range(len(names)), names)
    if sum(map(len, names)) * _CHARACTER > width / 2:
        axes.tick_params(axis="x", labelrotation=30)


def _names(plot: Plot) -> list[str]:
    return list(dict.fromkeys(name for one in plot["data"] for name in one["x"]))
