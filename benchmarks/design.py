"""How well `design` predicts: expected errors against simulations over many seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from rich.table import Table

from benchmarks.common import analyses, plain_table
from zenoh_cbef.analysis.design import design
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario.load import load

SEEDS = 20
LOSS = "fault=[{kind='loss', probability=0.3}]"
CASES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("average, L = 1", ("consensus.rounds=1",)),
    ("average, L = 3", ("consensus.rounds=3",)),
    ("average, L = 10", ("consensus.rounds=10",)),
    ("Chebyshev, L = 2", ("consensus.rounds=2", "consensus.acceleration=chebyshev")),
    ("Chebyshev, L = 5", ("consensus.rounds=5", "consensus.acceleration=chebyshev")),
    ("running sums, 30 % loss, L = 3", ("consensus.rounds=3", LOSS)),
    ("running sums, 30 % loss, L = 6", ("consensus.rounds=6", LOSS)),
    ("icf, L = 3", ("consensus.rounds=3", "filter.kind=icf")),
    ("ci, L = 3", ("consensus.rounds=3", "filter.kind=ci")),
)


def predicted(overrides: Sequence[str], seeds: int = SEEDS) -> Floats:
    """Position RMSE (m), its ratio to centralised, velocity RMSE (m/s) and NEES, (seeds, 4), before any run."""
    found = []
    for seed in range(1, seeds + 1):
        told = design(load("tracking", [f"seed={seed}", *overrides]).plan, search=False).configured.expected
        found.append(
            [getattr(told, name) for name in ("position_rmse", "ratio_to_centralized", "velocity_rmse", "nees")]
        )
    return np.array(found)


def simulated(overrides: Sequence[str], seeds: int = SEEDS) -> Floats:
    """The same from simulations, (seeds, 4)."""
    return np.array(
        [
            [
                pick(run.metrics, name)
                for name in ("position_rmse", "ratio_to_centralized", "velocity_rmse", "nees.average")
            ]
            for run in analyses("tracking", overrides, seeds=seeds)
        ]
    )


def rows() -> list[list[object]]:
    """Per case: pooled RMSE, median ratio and mean NEES, predicted and simulated."""
    table: list[list[object]] = []
    for name, overrides in CASES:
        before, after = predicted(overrides), simulated(overrides)
        row: list[object] = [name]
        for column in (0, 2):
            row += [float(np.sqrt((one[:, column] ** 2).mean())) for one in (before, after)]
        row += [float(np.median(one[:, 1])) for one in (before, after)]
        row += [float(one[:, 3].mean()) for one in (before, after)]
        table.append(row)
    return table


def run(repeats: int) -> Iterator[Table]:
    """Nothing is timed, so nothing is repeated."""
    del repeats
    pairs = ("position", "velocity", "ratio", "NEES")
    heads = [f"{what} {when}" for what in pairs for when in ("predicted", "simulated")]
    yield plain_table(f"tracking, sicf unless said, {SEEDS} seeds", ["case", *heads], rows())
