"""A trace as plain arrays for other programs: .npz, or a folder of .csv."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.messages import BIAS, DISTRUST
from zenoh_cbef.trace import Trace

Array = NDArray[np.float64] | NDArray[np.int64]


def arrays_of(trace: Trace) -> dict[str, Array]:
    """The exported arrays, documented in docs/log-format.md; n agents, K steps, m edges, NaN where nothing is."""
    return {
        "time": trace.time,
        "truth": trace.truth,
        "positions": trace.positions,
        "ranges": trace.ranges,
        "initial": trace.initial,
        "estimates": trace.estimates,
        "covariances": trace.covariances,
        "innovation": trace.innovation,
        "weight": trace.weight,
        "nis": trace.nis,
        "nis_degrees": trace.nis_degrees,
        "distrust": trace.distrust,
        "bias": trace.bias,
        "edges": trace.edges,
    }


def export(trace: Trace, output: Path, kind: Literal["npz", "csv"]) -> list[Path]:
    """Write the arrays to a file (npz) or into a folder (csv); returns what was written."""
    try:
        if kind == "npz":
            output.parent.mkdir(parents=True, exist_ok=True)
            with output.open("wb") as stream:
                np.savez_compressed(stream, allow_pickle=False, **arrays_of(trace))
            return [output]
        output.mkdir(parents=True, exist_ok=True)
        return _write_tables(trace, output)
    except OSError as error:
        raise UserError(f"cannot write {output}: {error.strerror}; choose another --output") from None


def _write_tables(trace: Trace, folder: Path) -> list[Path]:
    count, steps = trace.ranges.shape
    agent, step = np.repeat(np.arange(count), steps), np.tile(np.arange(1, steps + 1), count)
    rows, columns = np.triu_indices(6)
    axes = ("x", "y", "z")
    state = [*axes, *(f"v{axis}" for axis in axes)]
    upper = [f"p{row}{column}" for row, column in zip(rows, columns, strict=True)]
    tables = {
        "truth": (["k", "time", *state], [np.arange(1, steps + 1), trace.time, trace.truth]),
        "initial": (["agent", *state], [np.arange(count), trace.initial]),
        "edges": (["first", "second"], [trace.edges]),
        "agents": (
            ["agent", "k", "time", *axes, "range"],
            [agent, step, np.tile(trace.time, count), trace.positions.reshape(-1, 3), trace.ranges.ravel()],
        ),
        "estimates": (
            ["agent", "k", "time", *state, "innovation", "weight", *upper, "nis", "nis_degrees", *BIAS, DISTRUST],
            [
                agent,
                step,
                np.tile(trace.time, count),
                trace.estimates.reshape(-1, 6),
                trace.innovation.ravel(),
                trace.weight.ravel(),
                trace.covariances[:, :, rows, columns].reshape(count * steps, -1),
                trace.nis.ravel(),
                trace.nis_degrees.ravel(),
                trace.bias.reshape(-1, 3),
                trace.distrust.ravel(),
            ],
        ),
    }
    paths = []
    for name, (header, parts) in tables.items():
        path = folder / f"{name}.csv"
        whole = {"agent", "k", "first", "second", "nis_degrees"}
        formats = ["%d" if column in whole else "%.17g" for column in header]
        np.savetxt(path, np.column_stack(parts), formats, ",", header=",".join(header), comments="")
        paths.append(path)
    return paths
