"""Error against bytes on a link, by filter, number of rounds, precision and silence; the figures of docs/bytes.md."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from rich.table import Table

from benchmarks.common import Row, below, drawn, plain_table, results
from benchmarks.method_figures import FOLDER, STYLE, canvas, save
from zenoh_cbef.analysis.figures import COLOURS
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.analysis.traffic import round_bytes
from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.compact import PRECISIONS

SEEDS, MANY, FIRST = 10, 50, 7001
ROUNDS = (2, 5, 10)
TRIGGERS = (0.05, 0.1, 0.2, 0.3, 0.5, 1.0)
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
QUIET = 0.1
RECOMMENDED = "sicf, L = 8, int12, trigger 0.1"
LOSSY = "icf, L = 5, float32"


@dataclass(frozen=True)
class Setting:
    """In which numbers payloads travel, and when agents keep silent."""

    precision: str = "float64"
    trigger: float = 0.0

    @property
    def keys(self) -> tuple[str, str]:
        """As keys of a scenario."""
        return f"consensus.precision='{self.precision}'", f"consensus.trigger={self.trigger}"

    def __str__(self) -> str:
        return self.precision + (f", trigger {self.trigger:g}" if self.trigger else "")


SETTINGS = (*map(Setting, PRECISIONS), Setting("int12", QUIET))


@dataclass(frozen=True)
class Point:
    """What a setting costs and reaches, by seed (s,). size: bytes of a message; step: of a step on a link.

    silent: share of the rounds. rmse: of the position, m. nees: over its ideal.
    """

    size: int
    step: float
    silent: float
    rmse: Floats
    nees: Floats

    def beside(self, other: Point) -> list[object]:
        """Cells of a row: bytes and their share of another point's, errors and their ratio to its, NEES."""
        ratio = self.rmse / other.rmse
        total, plain = (float(np.sqrt(np.mean(one.rmse**2))) for one in (self, other))
        spread = float(self.nees.std(ddof=1) / np.sqrt(len(self.nees)))
        return [
            self.size,
            f"{self.silent:.0%}" if self.silent else "",
            round(self.step),
            f"{self.step / other.step:.3f}",
            total,
            f"{np.median(ratio):.4f}",
            f"{total / plain:.4f}",
            f"{self.nees.mean():.3f} +- {spread:.3f}",
        ]


COLUMNS = ("message (B)", "silent", "step (B)", "share", "RMSE (m)", "ratio, median", "of all", "NEES/ideal")


def measured(keys: tuple[str, ...], rounds: int, setting: Setting, seeds: int = SEEDS) -> Point | None:
    """Simulate `tracking` with these keys; None where the filter does not allow the setting."""
    loaded = load("tracking", [*keys, f"consensus.rounds={rounds}", *setting.keys])
    if (setting.precision.startswith("int") or setting.trigger) and not loaded.plan.sharing.blocks:
        return None
    runs = analyze(simulate(drawn(loaded.scenario, seeds, FIRST)))
    told = [[pick(one.metrics, name) for one in runs] for name in ("position_rmse", "nees.average")]
    steps, silent = ([pick(one.metrics, name) for one in runs] for name in ("link_bytes_per_step", "silent"))
    dimension = next((one.metrics.nees.dimension for one in runs if one.metrics.nees), np.nan)
    quiet = float(np.nan_to_num(silent).mean())
    rmse, nees = np.array(told)
    return Point(round_bytes(loaded.plan), float(np.mean(steps)), quiet, rmse, nees / dimension)


def _by_precision() -> tuple[Table, dict[tuple[int, Setting], Point]]:
    rows, found = list[list[object]](), dict[tuple[int, Setting], Point]()
    for name, keys in CASES.items():
        for rounds in ROUNDS if name == "sicf" else ROUNDS[-1:]:
            plain = measured(keys, rounds, SETTINGS[0])
            for setting in SETTINGS:
                one = plain if setting == SETTINGS[0] else measured(keys, rounds, setting)
                if one is not None and plain is not None:
                    rows.append([name, rounds, setting, *one.beside(plain)])
                    if name == "sicf":
                        found[rounds, setting] = one
    title = f"tracking, {SEEDS} seeds, beside float64 with as many rounds; bytes of a step are on one link, one way"
    return plain_table(title, ("case", "L", "numbers", *COLUMNS), rows), found


def _by_trigger() -> tuple[Table, list[Point]]:
    plain = measured(CASES["sicf"], ROUNDS[-1], SETTINGS[0])
    points = [measured(CASES["sicf"], 8, Setting("int12", trigger)) for trigger in (0.0, *TRIGGERS)]
    rows = [
        [trigger, *one.beside(plain)] for trigger, one in zip((0.0, *TRIGGERS), points, strict=True) if one and plain
    ]
    title = f"sicf, L = 8, int12, {SEEDS} seeds, beside L = 10 in float64"
    return plain_table(title, ("trigger", *COLUMNS), rows), [one for one in points if one]


def _searched(loss: tuple[str, ...]) -> tuple[list[list[object]], dict[str, Point], Point]:
    """Settings of a quarter of the bytes, beside sicf with ten rounds in float64."""
    plain = measured((*CASES["sicf"], *loss), 10, SETTINGS[0], MANY)
    tried = [("sicf", rounds, Setting("float32")) for rounds in (4, 5, 6)] + [("icf", 5, Setting("float32"))]
    tried += [("sicf", rounds, Setting("int12", quiet)) for rounds in (6, 8) for quiet in (0.0, QUIET)]
    rows, found = list[list[object]](), dict[str, Point]()
    if plain is None:
        raise ValueError("sicf allows float64")
    for kind, rounds, setting in tried:
        if (one := measured((*CASES[kind], *loss), rounds, setting, MANY)) is not None:
            name = f"{kind}, L = {rounds}, {setting}"
            rows.append([name, *one.beside(plain)])
            found[name] = one
    return rows, found, plain


def _goal(name: str, one: Point, plain: Point) -> Table:
    return results(
        f"{name}, {MANY} seeds, beside sicf with ten rounds in float64",
        [
            Row("bytes of a step on a link", f"{one.step / plain.step:.3f}", "<= 0.25", one.step <= plain.step / 4.0),
            below("position RMSE, ratio, median", float(np.median(one.rmse / plain.rmse)), 1.01),
            below("NEES / ideal", float(one.nees.mean()), 1.05),
        ],
    )


def draw(found: dict[tuple[int, Setting], Point], triggers: list[Point]) -> None:
    """Position error of sicf against bytes: a line for each setting with a point for each L; beside it, triggers."""
    with mpl.rc_context(STYLE):
        figure, (left, right) = canvas(2)
        for setting, colour in zip(SETTINGS, COLOURS, strict=False):
            points = [found[rounds, setting] for rounds in ROUNDS]
            left.plot(*_curve(points), ".-", color=colour, label=str(setting))
        right.plot(*_curve(triggers), ".-", color=COLOURS[0])
        for trigger, one in zip((0.0, *TRIGGERS), triggers, strict=True):
            right.annotate(f" {trigger:g}", (_curve([one])[0][0], _curve([one])[1][0]))
        left.set(xlabel="bytes per step on a link, one way", ylabel="position RMSE (m)", xscale="log")
        right.set(xlabel="the same; L = 8, int12, by trigger", ylabel="position RMSE (m)")
        left.set_xticks([200, 500, 1000, 2000], ["200", "500", "1000", "2000"])
        left.minorticks_off()
        left.set_xlim(60)
        left.legend(frameon=False, loc="lower left")
        save(figure, FOLDER, "bytes")


def _curve(points: list[Point]) -> tuple[list[float], list[float]]:
    return [one.step for one in points], [float(np.sqrt(np.mean(one.rmse**2))) for one in points]


def run(repeats: int) -> Iterator[Table]:
    """Nothing is timed."""
    del repeats
    for title, loss, best in (("clean links", (), RECOMMENDED), ("30 % loss", (_LOSS,), LOSSY)):
        rows, searched, plain = _searched(loss)
        yield plain_table(f"{title}, {MANY} seeds, beside sicf, L = 10, float64", ("setting", *COLUMNS), rows)
        yield _goal(f"{title}: {best}", searched[best], plain)
    table, triggers = _by_trigger()
    yield table
    table, found = _by_precision()
    yield table
    draw(found, triggers)
