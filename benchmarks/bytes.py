"""Error against bytes on a link, by filter, number of rounds and precision; the figure of docs/bytes.md."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from rich.table import Table

from benchmarks.common import Row, below, plain_table, results
from benchmarks.method_figures import FOLDER, STYLE, canvas, save
from zenoh_cbef.analysis.demand import demand
from zenoh_cbef.analysis.figures import COLOURS
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.analysis.traffic import round_bytes
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.compact import PRECISIONS, Precision

SEEDS, FIRST = 10, 7001
ROUNDS = (2, 5, 10)
_LOSS = "fault=[{kind='loss', probability=0.3}]"
CASES = {
    "sicf": ("filter.kind='sicf'",),
    "icf": ("filter.kind='icf'",),
    "ci": ("filter.kind='ci'",),
    "sicf, 1 km off": ("filter.kind='sicf'", "target.position=[1000,1000,1000]", "agents.low=990", "agents.high=1010"),
    "sicf, 30 % loss": ("filter.kind='sicf'", _LOSS),
    "hcmci": ("filter.kind='hcmci'",),
    "kcf": ("filter.kind='kcf'",),
}
RECOMMENDED: Precision = "int12"


@dataclass(frozen=True)
class Point:
    """What a setting costs and reaches. size: bytes of a message; step: of a step on a link, with Zenoh's envelope.

    rmse: of the position, m, root mean square over seeds. ratio: of it, to the same in float64 seed by seed, median;
    worst: the largest. nees: over its ideal, mean.
    """

    size: int
    step: float
    rmse: float
    ratio: float
    worst: float
    nees: float


def measured(keys: tuple[str, ...], rounds: int) -> dict[Precision, Point]:
    """The precisions of a case that its filter allows."""
    found: dict[Precision, Point] = {}
    plain = np.zeros(0)
    for precision in PRECISIONS:
        loaded = load("tracking", [*keys, f"consensus.rounds={rounds}", f"consensus.precision='{precision}'"])
        if precision.startswith("int") and not loaded.plan.sharing.blocks:
            continue
        scenario = loaded.scenario
        runs = analyze(simulate([scenario.model_copy(update={"seed": FIRST + one}) for one in range(SEEDS)]))
        rmse = np.array([pick(one.metrics, "position_rmse") for one in runs])
        nees = [pick(one.metrics, "nees.average") / one.metrics.nees.dimension for one in runs if one.metrics.nees]
        plain = plain if plain.size else rmse
        step = demand(loaded.plan).link * scenario.dt / 8.0
        ratio = rmse / plain
        found[precision] = Point(
            round_bytes(loaded.plan),
            step,
            float(np.sqrt(np.mean(rmse**2))),
            float(np.median(ratio)),
            float(ratio.max()),
            float(np.mean(nees)) if nees else np.nan,
        )
    return found


def draw(found: dict[tuple[str, int], dict[Precision, Point]]) -> None:
    """Position error of sicf against bytes, a line for each precision, a point for each L."""
    with mpl.rc_context(STYLE):
        figure, (axes,) = canvas()
        for precision, colour in zip(PRECISIONS, COLOURS, strict=False):
            points = [found["sicf", rounds][precision] for rounds in ROUNDS]
            axes.plot([one.step for one in points], [one.rmse for one in points], ".-", color=colour, label=precision)
        axes.set(xlabel="bytes per step on a link, one way", ylabel="position RMSE (m)", xscale="log")
        axes.legend(frameon=False)
        save(figure, FOLDER, "bytes")


def run(repeats: int) -> Iterator[Table]:
    """Nothing is timed."""
    del repeats
    found = {
        (name, rounds): measured(keys, rounds)
        for name, keys in CASES.items()
        for rounds in (ROUNDS if name == "sicf" else ROUNDS[-1:])
    }
    draw(found)
    columns = ("case", "L", "precision", "message (B)", "step (B)", "RMSE (m)", "/ float64", "worst", "NEES/ideal")
    rows = [
        (name, rounds, precision, one.size, round(one.step), one.rmse, f"{one.ratio:.4f}", f"{one.worst:.4f}", one.nees)
        for (name, rounds), points in found.items()
        for precision, one in points.items()
    ]
    yield plain_table(f"tracking, {SEEDS} seeds; bytes of a step are on one link, one way", columns, rows)
    plain, short = (found["sicf", 10][one] for one in ("float64", RECOMMENDED))
    yield results(
        f"recommended: {RECOMMENDED}, sicf, L = 10",
        [
            Row("message", f"{short.size} B", f"<= {plain.size / 4:g} B", short.size <= plain.size / 4),
            below("position RMSE / float64, median", short.ratio, 1.01),
            below("NEES / ideal", short.nees, 1.05),
        ],
    )
