"""The figures of docs/method.md, and the numbers behind them as tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.table import Table

from benchmarks import method_studies as studies
from benchmarks.accuracy import consistency, msee_factors, position_mse, ratios
from benchmarks.common import ROOT, SEEDS, plain_table
from zenoh_cbef.analysis.figures import COLOURS, INK, MUTED
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.arrays import Floats

FOLDER = ROOT / "docs" / "figures"
_FLOOR = 1e-5
_BLUE, _ORANGE, _GREEN = COLOURS[:3]
STYLE: dict[Any, Any] = {
    "font.size": 8,
    "legend.fontsize": 7,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.linewidth": 0.4,
    "grid.color": "#d5d9dd",
    "lines.linewidth": 1.2,
    # Without these the same numbers would give other bytes each time.
    "svg.hashsalt": "zenoh-cbef",
    "svg.fonttype": "path",
}


def canvas(panels: int = 1) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(3.4 * panels if panels > 1 else 4.6, 2.7), layout="constrained")
    return figure, list(np.atleast_1d(np.asarray(figure.subplots(1, panels))))


def save(figure: Figure, folder: Path, name: str) -> None:
    figure.savefig(folder / f"{name}.svg", metadata={"Date": None})


def _quartiles(axes: Axes, x: Floats, values: Floats, *, colour: str, label: str, dash: str = "-") -> None:
    """Draw the median over seeds (axis 0), and a band from the first to the third quartile."""
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75], axis=0)
    axes.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0.0)
    axes.plot(x, middle, dash, color=colour, label=label)


def _median(values: Floats) -> float:
    return float(np.median(values))


def paper(folder: Path) -> Table:
    """Average MSEE of the literal filter in the paper's regime."""
    runs = studies.paper()
    time, msee = runs[0].trace.time, np.stack([run.msee_average for run in runs])
    figure, (axes,) = canvas()
    for row in msee:
        axes.plot(time, row, color=_BLUE, linewidth=0.5, alpha=0.45)
    axes.plot(time, np.median(msee, axis=0), color=INK, label=f"median of {len(runs)} seeds")
    axes.set(xlabel="time (s)", ylabel="average MSEE (m² + m²/s²)", yscale="log", xlim=(0.0, time[-1]))
    axes.legend(frameon=False)
    save(figure, folder, "paper-msee")
    steps = [step for step in (1, 10, 30, 100, 300) if step <= len(time)]
    rows: list[list[object]] = [
        [step, _median(msee[:, step - 1]), float(msee[:, step - 1].min()), float(msee[:, step - 1].max())]
        for step in steps
    ]
    factor = msee_factors(runs)
    rows.append(["falls by, first to last", _median(factor), float(factor.min()), float(factor.max())])
    rows.append(["seeds in which it falls", f"{(factor > 1.0).sum()} of {len(runs)}", "", ""])
    return plain_table("(a) paper: average MSEE", ["step", "median", "least", "largest"], rows)


def scale(folder: Path) -> Table:
    """Position MSE against the size of the cube."""
    found = [studies.scale(side) for side in studies.SIDES]
    sides = np.array([one.side for one in found])
    figure, (left, right) = canvas(2)
    arms = (
        ("cbef", _BLUE, "cbef", "-"),
        ("sicf", _ORANGE, "sicf, same start", "-"),
        ("sicf_near", _GREEN, "sicf, start known to 0.3 m", "--"),
    )
    for part, colour, label, dash in arms:
        values = np.stack([getattr(one, part) for one in found], axis=1)
        _quartiles(left, sides, values, colour=colour, label=label, dash=dash)
    left.set(xlabel="side of the cube (m)", ylabel="position MSE (m²)", xscale="log", yscale="log")
    eigenvalue = np.array([_median(one.eigenvalue) for one in found])
    radius = np.array([_median(one.radius) for one in found])
    right.plot(sides, eigenvalue, color=_BLUE, label="largest eigenvalue of $H^TH$")
    right.plot(sides, radius, "--", color=INK, label="spectral radius of one step")
    for limit, colour in ((2.0, _BLUE), (1.0, INK)):
        right.axhline(limit, color=colour, linewidth=0.6, linestyle=":")
    right.set(xlabel="side of the cube (m)", xscale="log", yscale="log")
    # Where the median passes 2, on straight lines between the sides in log-log.
    crossing = float(np.exp(np.interp(np.log(2.0), np.log(eigenvalue), np.log(sides))))
    for axes in (left, right):
        axes.axvline(crossing, color=MUTED, linewidth=0.8, linestyle=":")
        axes.legend(frameon=False)
    right.annotate(
        f"eigenvalue 2 at {crossing:.2g} m",
        (crossing * 1.1, 0.03),
        color=MUTED,
        fontsize=7,
        xycoords=("data", "axes fraction"),
    )
    save(figure, folder, "scale")
    return _scale_table(found, crossing)


def _scale_table(found: list[studies.Scale], crossing: float) -> Table:
    """The numbers of the figure; crossing: the side, m, at which the median of the largest eigenvalue passes 2."""
    rows = [
        [
            f"{one.side:g}",
            _median(one.cbef),
            _median(one.sicf),
            _median(one.icf),
            _median(one.sicf_near),
            _median(one.eigenvalue),
            f"{(one.eigenvalue >= 2.0).sum()}",
            _median(one.radius),
            f"{(one.radius >= 1.0).sum()}",
        ]
        for one in found
    ]
    title = f"(b) scale: medians of {SEEDS} seeds; the median eigenvalue passes 2 at {crossing:.3g} m"
    columns = [
        "side (m)",
        "cbef MSE",
        "sicf MSE",
        "icf MSE",
        "sicf near",
        "eigenvalue",
        "seeds >= 2",
        "radius",
        "seeds >= 1",
    ]
    return plain_table(title, columns, rows)


def velocity(folder: Path) -> Table:
    """Velocity error over time, and what it does to the position."""
    runs = studies.velocity()
    time = runs["cbef"][0].trace.time
    figure, panels = canvas(2)
    rows: list[list[object]] = []
    for axes, part, unit in zip(panels, ("velocity_error", "position_error"), ("m/s", "m"), strict=True):
        for (kind, many), colour in zip(runs.items(), (_BLUE, _ORANGE), strict=True):
            errors = studies.network_rmse(many, part)
            _quartiles(axes, time[::10], errors[:, ::10], colour=colour, label=kind)
            steps = (1, 10, 100, 500, 1000, 2000)
            rows.append([f"{kind} {part.split('_')[0]} ({unit})", *(_median(errors[:, k - 1]) for k in steps)])
        name = part.replace("_", " ")
        axes.set(xlabel="time (s)", ylabel=f"{name} ({unit})", yscale="log", xlim=(0.0, time[-1]))
    carried = np.stack([studies.carried_velocity(run) for run in runs["cbef"]])
    panels[0].plot(time[::10], np.median(carried, axis=0)[::10], ":", color=INK, label="|mean initial guess - truth|")
    panels[0].legend(frameon=False)
    save(figure, folder, "velocity")
    rows.append(["predicted, cbef velocity", *(_median(carried[:, k - 1]) for k in steps)])
    mean = [run.trace.estimates[:, :, 3:].mean(axis=0) - run.trace.truth[:, 3:] for run in runs["cbef"]]
    gap = np.abs(np.linalg.norm(np.stack(mean), axis=2) - carried).max()
    rows.append(["network mean - predicted, largest", f"{gap:.1g}", *[""] * (len(steps) - 1)])
    return plain_table("(c) velocity: medians", ["step", *map(str, steps)], rows)


def saturation(folder: Path) -> Table:
    """What the bound xi on the innovation does, without and with outliers."""
    found = studies.saturation()
    figure, panels = canvas(2)
    rows: list[list[object]] = []
    for (name, arms), colour, dash in zip(found.items(), (_BLUE, _ORANGE), ("-", "--"), strict=True):
        for axes, runs, data in zip(panels, arms, ("clean", "10 % outliers"), strict=True):
            innovation = studies.innovations(runs)
            time = runs[0].trace.time
            _quartiles(axes, time[::2], innovation[:, ::2], colour=colour, label=name, dash=dash)
            axes.set(xlabel="time (s)", title=data, yscale="log", xlim=(0.0, time[-1]))
            weight = np.array([run.trace.diagnostics.weight[:, 0].mean() for run in runs])
            steps = (1, 3, 10, 30, 300)
            values = [_median(innovation[:, k - 1]) for k in steps]
            rows.append([f"{name}, {data}", *values, _median(weight), _median(position_mse(runs))])
    panels[0].set(ylabel="mean innovation norm (m²)")
    panels[0].legend(frameon=False)
    save(figure, folder, "saturation")
    columns = ["innovation at step", *map(str, steps), "gain at step 1", "position MSE"]
    return plain_table("(d) saturation: medians", columns, rows)


def _spreads(folder: Path, name: str, axis: str, many: dict[str, list[studies.Spread]], title: str) -> Table:
    figure, (axes,) = canvas()
    rows: list[list[object]] = []
    for (arm, found), colour, marker in zip(many.items(), (_BLUE, _ORANGE, _GREEN), ("o", "s", "^"), strict=False):
        whole = [one for one in found if one.broken == 0]
        x = [one.setting for one in whole]
        for pick, dash, label in ((np.median, "-", "median"), (np.max, ":", "worst seed")):
            # The network can be slightly better than the yardstick; a log axis shows that at its lower end.
            excess = [max(float(pick(one.ratios)) - 1.0, _FLOOR) for one in whole]
            axes.plot(x, excess, dash, color=colour, marker=marker, markersize=3, label=f"{arm}, {label}")
        rows += [
            [f"{arm}, {one.setting:g}", _median(one.ratios), float(one.ratios.max()), one.broken, one.nees]
            for one in found
        ]
    axes.axhline(0.01, color=MUTED, linewidth=0.8, linestyle=":")
    axes.set(xlabel=axis, ylabel="position RMSE / centralised - 1", yscale="log", ylim=(_FLOOR / 1.5, 300.0))
    axes.legend(frameon=False, ncols=2)
    save(figure, folder, name)
    return plain_table(title, [axis, "median ratio", "worst", "seeds broken", "mean NEES"], rows)


def rounds(folder: Path) -> Table:
    """Consensus error by rounds."""
    many = {"Metropolis": studies.rounds("none"), "Chebyshev": studies.rounds("chebyshev")}
    return _spreads(folder, "rounds", "rounds L", many, f"(e) rounds: tracking, {SEEDS} seeds")


def losses(folder: Path) -> Table:
    """Consensus error by lost messages."""
    many = {
        "Metropolis": studies.losses("average", "none"),
        "Chebyshev": studies.losses("average", "chebyshev"),
        "running sums": studies.losses("running-sums", "none"),
    }
    return _spreads(folder, "loss", "loss probability", many, f"(f) loss: tracking, L = 10, {SEEDS} seeds")


def filters() -> Iterator[Table]:
    """Every filter on the same measurements."""
    for name in ("tracking", "outliers"):
        rows = [[kind, *_filter_row(runs)] for kind, runs in studies.filters(name).items()]
        columns = ["filter", "position RMSE", "velocity RMSE", "median ratio", "worst ratio", "mean NEES"]
        yield plain_table(f"filters on {name}: medians of {SEEDS} seeds", columns, rows)


def _filter_row(runs: Sequence[Analysis]) -> list[object]:
    found = ratios(runs)
    speeds = np.array([run.metrics.velocity_rmse for run in runs])
    known = runs[0].metrics.nees is not None
    nees: object = consistency(runs).mean if known else "no covariance"
    return [_median(np.sqrt(position_mse(runs))), _median(speeds), _median(found), float(found.max()), nees]


def run(repeats: int, folder: Path = FOLDER) -> Iterator[Table]:
    """Draw everything; nothing is timed, so nothing is repeated."""
    del repeats
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(STYLE):
        for draw in (paper, scale, velocity, saturation, rounds, losses):
            yield draw(folder)
    yield from filters()
