"""The tidy table: one row per run, as CSV and as Parquet."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path

from zenoh_cbef.experiment.cells import Cell
from zenoh_cbef.experiment.results import Outcome
from zenoh_cbef.extras import MissingExtra, from_extra
from zenoh_cbef.plain import Json

Value = str | float | None
Row = dict[str, Value]


def rows_of(cells: Sequence[Cell], outcomes: Sequence[Sequence[Outcome]]) -> list[Row]:
    """One row per run: cell, varied values, seed, the error if the run failed, and all scalar metrics."""
    rows = [
        {
            "cell": cell.index,
            **{key: _plain(value) for key, value in cell.values.items()},
            "seed": run.seed,
            "error": run.error,
            **{name: value for name, value in run.metrics.items() if name not in {"seed", *cell.values}},
        }
        for cell, runs in zip(cells, outcomes, strict=True)
        for run in runs
    ]
    columns = dict.fromkeys(name for row in sorted(rows, key=len, reverse=True) for name in row)
    return [{name: row.get(name) for name in columns} for row in rows]


def write_table(rows: Sequence[Row], folder: Path) -> str:
    """Write results.csv and results.parquet; returns why there is no Parquet, if there is none."""
    with (folder / "results.csv").open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    try:
        arrow, parquet = (from_extra(name, "results.parquet") for name in ("pyarrow", "pyarrow.parquet"))
    except MissingExtra as missing:
        return str(missing)
    columns: dict[str, object] = {name: _uniform([row[name] for row in rows]) for name in rows[0]}
    columns["seed"] = arrow.array(columns["seed"], arrow.uint64())
    parquet.write_table(arrow.table(columns), folder / "results.parquet")
    return ""


def _plain(value: Json) -> Value:
    if isinstance(value, str | float | int | None):
        return value
    return json.dumps(value)


def _uniform(values: list[Value]) -> list[Value]:
    """Give a column one type: numbers as they are, whole ones among others as floats, else text."""
    kinds = {type(value) for value in values if value is not None}
    if len(kinds) <= 1:
        return values
    if kinds == {int, float}:
        return [None if value is None else float(value) for value in values]
    return [None if value is None else str(value) for value in values]
