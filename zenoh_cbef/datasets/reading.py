"""From a folder to a dataset."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.table import Table, read_table
from zenoh_cbef.datasets.units import clash_of_units
from zenoh_cbef.errors import UserError


def read_dataset(folder: Path) -> Dataset:
    """Read a recorded set. Raises UserError where a file is missing, empty or not as documented, or in another unit."""
    found = read_files(folder)
    if clash := clash_of_units(found):
        raise UserError(f"{folder}: {clash.said}")
    return found


def read_files(folder: Path) -> Dataset:
    """Read a recorded set, whatever its unit. Raises UserError where a file is missing, empty or not as documented."""
    anchors, ranges = read_table(folder, "anchors"), read_table(folder, "ranges")
    truth = read_table(folder, "truth") if (folder / "truth.csv").exists() else Table([], np.empty((0, 4)))
    index = {label: row for row, label in enumerate(anchors.names)}
    if len(index) < len(anchors.names):
        raise UserError(f"{folder / 'anchors.csv'} names an anchor twice; give every anchor its own id")
    unknown = sorted({*ranges.names} - index.keys())
    if unknown:
        raise UserError(f"{folder / 'ranges.csv'} has ranges of anchor {unknown[0]}, which anchors.csv lacks; add it")
    rows = np.column_stack([ranges.numbers, [index[label] for label in ranges.names]])
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    rows = rows[rows[:, 1] >= 0.0]
    if len(rows) == 0:
        raise UserError(f"{folder / 'ranges.csv'} has negative ranges only; a dataset needs at least one range")
    known = truth.numbers[np.argsort(truth.numbers[:, 0], kind="stable")]
    return Dataset(
        labels=tuple(anchors.names),
        anchors=anchors.numbers,
        range_time=rows[:, 0],
        range_anchor=rows[:, 2].astype(np.intp),
        ranges=rows[:, 1],
        truth_time=known[:, 0],
        truth=known[:, 1:4],
    )
