"""A picture of a recording before any filter: anchors, the first fix, rough fixes, and the truth if there is one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.fixes import fixes
from zenoh_cbef.extras import from_extra
from zenoh_cbef.writing import whole

_SHARE = 5.0
"""Per cent of the fixes that may lie beyond the picture, at each side: one far off would leave the rest a dot."""
_MARGIN = 0.06


def limits(dataset: Dataset, places: Floats) -> tuple[Floats, Floats]:
    """The least and largest x and y that are drawn, m: anchors, truth, and most of the fixes, places (f, 2 or 3)."""
    most = [np.percentile(places[:, :2], [_SHARE, 100.0 - _SHARE], axis=0)] if len(places) else []
    shown = np.concatenate([dataset.anchors[:, :2], dataset.truth[:, :2], *most])
    low, high = shown.min(axis=0), shown.max(axis=0)
    margin = _MARGIN * float((high - low).max()) or 1.0
    return low - margin, high + margin


def draw(dataset: Dataset, path: Path) -> Path:
    """Draw it, seen from above, as .png or .svg. Raises MissingExtra where matplotlib is not installed."""
    figures = from_extra("matplotlib.figure", "the picture")
    figure = figures.Figure(figsize=(6.4, 5.2))
    # Margins that are given: to find them takes as long as the drawing.
    axes = figure.subplots(gridspec_kw={"left": 0.13, "right": 0.98, "bottom": 0.1, "top": 0.95})
    found = fixes(dataset)
    if dataset.has_truth:
        axes.plot(dataset.truth[:, 0], dataset.truth[:, 1], color="0.75", lw=4, label="truth", zorder=1)
    if len(found.time):
        axes.plot(found.places[:, 0], found.places[:, 1], ".", ms=4, color="tab:blue", label="rough fixes", zorder=2)
        axes.plot(*found.places[0, :2], "*", ms=14, color="tab:orange", label="first fix", zorder=3)
    axes.plot(dataset.anchors[:, 0], dataset.anchors[:, 1], "D", color="black", label="anchors", zorder=4)
    for label, place in zip(dataset.labels, dataset.anchors, strict=True):
        axes.annotate(label, place[:2], xytext=(5, 5), textcoords="offset points")
    axes.set_aspect("equal", adjustable="box")
    low, high = limits(dataset, found.places)
    axes.set(xlabel="x (m)", ylabel="y (m)", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.grid(visible=True, color="0.9")
    axes.legend(fontsize="small")
    with whole(path) as fresh:
        figure.savefig(fresh, dpi=120)
    return path
