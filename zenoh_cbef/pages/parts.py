"""The parts of pages: tables, figures, numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from zenoh_cbef import numbers

NOTHING = "n/a"

Plot = dict[str, Any]
"""Data and layout as plotly.js draws them. `meta` of a line names a colour of the stylesheet, for light and dark."""


@dataclass(frozen=True)
class Table:
    """Text in rows and columns. caption: what is in it; heads: of the columns; either may be empty."""

    caption: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Figure:
    """One picture. name: of its file and its place in the page. plot: None where there is nothing to draw."""

    name: str
    title: str
    caption: str
    plot: Plot | None


def plots_of(figures: Iterable[Figure]) -> dict[str, Plot]:
    """The plots by the names of their places."""
    return {figure.name: figure.plot for figure in figures if figure.plot is not None}


def number(value: float | None) -> str:
    """A number as it is written everywhere, or that there is none."""
    return numbers.number(value, nothing=NOTHING)
