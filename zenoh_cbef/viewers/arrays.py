"""A trace as plain arrays for other programs: .npz, or a folder of .csv or .parquet."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from zenoh_cbef.arrays import Floats, Ints
from zenoh_cbef.extras import from_extra
from zenoh_cbef.trace import SmoothedPath, Trace
from zenoh_cbef.tracking.diagnostics import NAMES, WHOLE
from zenoh_cbef.writing import make_folder, whole

WHOLE_COLUMNS = {"agent", "k", "first", "second"} | WHOLE
"""Columns of whole numbers."""

Array = Floats | Ints


def arrays_of(trace: Trace) -> dict[str, Array]:
    """The exported arrays, documented in docs/log-format.md; n agents, K steps, m edges, NaN where nothing is."""
    return {
        "time": trace.time,
        **({} if trace.source_time is None else {"source_time": trace.source_time}),
        "truth": trace.truth,
        "positions": trace.positions,
        "ranges": trace.ranges,
        "range_time": trace.range_time,
        "initial": trace.initial,
        "estimates": trace.estimates,
        "covariances": trace.covariances,
        **trace.diagnostics.named(),
        # One array of three since 0.1.0.
        "bias": np.stack([getattr(trace.diagnostics, name) for name in ("bias", "bias_std", "bias_weight")], axis=2),
        "edges": trace.edges,
        **({} if trace.smoothed is None else _smoothed(trace.smoothed)),
    }


def _smoothed(path: SmoothedPath) -> dict[str, Array]:
    return {"smoothed": path.states, "smoothed_covariances": path.covariances}


def export(trace: Trace, output: Path, kind: str) -> list[Path]:
    """Write the arrays to a file (npz) or as tables into a folder (csv, parquet); returns what was written.

    Raises UserError where that cannot be, or the package for parquet is missing.
    """
    write = _write_csv if kind == "csv" else _parquet_writer() if kind == "parquet" else None
    if write is None:
        with whole(output) as fresh, fresh.open("wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, **arrays_of(trace))
        return [output]
    make_folder(output)
    paths = []
    for name, (header, parts) in tables_of(trace).items():
        paths.append(output / f"{name}.{kind}")
        with whole(paths[-1]) as fresh:
            write(fresh, header, np.column_stack(parts).astype(np.float64))
    return paths


def _write_csv(path: Path, header: list[str], rows: Floats) -> None:
    formats = ["%d" if column in WHOLE_COLUMNS else "%.17g" for column in header]
    np.savetxt(path, rows, formats, ",", header=",".join(header), comments="")


def _parquet_writer() -> Callable[[Path, list[str], Floats], None]:
    arrow, parquet = from_extra("pyarrow", "parquet"), from_extra("pyarrow.parquet", "parquet")

    def write(path: Path, header: list[str], rows: Floats) -> None:
        columns = {
            name: column.astype(np.int64) if name in WHOLE_COLUMNS else column
            for name, column in zip(header, rows.T, strict=True)
        }
        parquet.write_table(arrow.table(columns), path)

    return write


def tables_of(trace: Trace) -> dict[str, tuple[list[str], list[Array]]]:
    """Header and columns of the tables by their names."""
    count, steps = trace.ranges.shape
    agent, step = np.repeat(np.arange(count), steps), np.tile(np.arange(1, steps + 1), count)
    axes = ("x", "y", "z")
    state = [*axes, *(f"v{axis}" for axis in axes)]
    upper = [f"p{row}{column}" for row, column in zip(*np.triu_indices(6), strict=True)]
    clock = {"time": trace.time} | ({} if trace.source_time is None else {"source_time": trace.source_time})
    times = list(clock.values())
    place: list[Array] = [agent, step, *(np.tile(one, count) for one in times)]
    tables: dict[str, tuple[list[str], list[Array]]] = {
        "truth": (["k", *clock, *state], [np.arange(1, steps + 1), *times, trace.truth]),
        "initial": (["agent", *state], [np.arange(count), trace.initial]),
        "edges": (["first", "second"], [trace.edges]),
        "agents": (
            ["agent", "k", *clock, *axes, "range", "range_time"],
            [*place, trace.positions.reshape(-1, 3), trace.ranges.ravel(), trace.range_time.ravel()],
        ),
        "estimates": (
            ["agent", "k", *clock, *state, *NAMES, *upper],
            [
                *place,
                trace.estimates.reshape(-1, 6),
                *trace.diagnostics.each(np.ravel).named().values(),
                _upper(trace.covariances),
            ],
        ),
    }
    if (path := trace.smoothed) is not None:
        numbers = [*place, path.states.reshape(-1, 6), _upper(path.covariances)]
        tables["smoothed"] = (["agent", "k", *clock, *state, *upper], numbers)
    return tables


def _upper(covariances: Floats) -> Floats:
    """The upper triangles of (n, K, 6, 6), a row for each agent and step."""
    rows, columns = np.triu_indices(6)
    return covariances[:, :, rows, columns].reshape(-1, len(rows))
