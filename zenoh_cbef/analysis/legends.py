"""The legend below a figure on paper, in as many columns as its width takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

_INCHES = 0.87
"""What a column needs at least."""


def legend_below(figure: Figure, handles: Sequence[Artist], names: Sequence[str]) -> None:
    """Name lines below a figure. Long names get fewer columns, so that none leaves the figure."""
    most = max(1, min(len(names), int(figure.get_size_inches()[0] / _INCHES)))
    for columns in range(most, 0, -1):
        legend = figure.legend(
            handles,
            names,
            loc="outside lower center",
            ncols=columns,
            frameon=False,
            handlelength=1.8,
            columnspacing=1.2,
        )
        if columns == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()
