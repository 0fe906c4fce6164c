"""A picture of a recording before any filter: anchors, the first fix, rough fixes, and the truth if there is one."""

from __future__ import annotations

from pathlib import Path

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.fixes import fixes
from zenoh_cbef.extras import from_extra


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
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.grid(visible=True, color="0.9")
    axes.legend(fontsize="small")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    return path
