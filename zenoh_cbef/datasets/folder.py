"""From a folder to a dataset, and back."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from zenoh_cbef.datasets.anchorwise import scaled_anchors
from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.table import COLUMNS, Table, read_table
from zenoh_cbef.datasets.units import clash_of_units
from zenoh_cbef.errors import UserError
from zenoh_cbef.writing import make_folder, whole, writing


def read_dataset(folder: Path) -> Dataset:
    """Read a recorded set. Raises UserError where a file is missing, empty or not as documented, or in another unit."""
    found = read_files(folder)
    if clash := clash_of_units(found):
        raise UserError(f"{folder}: {'; '.join(scaled_anchors(found) or [clash.said])}")
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
    rows = rows[rows[:, 1] >= 0.0]
    order = np.argsort(rows[:, 0], kind="stable")
    rows = rows[order]
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
        order=order,
    )


def write_dataset(dataset: Dataset, folder: Path) -> list[Path]:
    """Write a recorded set; returns its files. Every number reads back as it was, and ranges are in their order.

    A truth.csv that is there, where the dataset has no truth, goes: it would be another recording's. Raises UserError
    where the folder cannot be written.
    """
    labels = dataset.labels
    tables: dict[str, Iterable[Sequence[object]]] = {
        "anchors": [(label, *row) for label, row in zip(labels, dataset.anchors.tolist(), strict=True)],
        "ranges": [
            (float(dataset.range_time[row]), labels[dataset.range_anchor[row]], float(dataset.ranges[row]))
            for row in (range(len(dataset.ranges)) if dataset.order is None else np.argsort(dataset.order))
        ],
    }
    if dataset.has_truth:
        known = zip(dataset.truth_time.tolist(), dataset.truth.tolist(), strict=True)
        tables["truth"] = [(time, *row) for time, row in known]
    files = [folder / f"{name}.csv" for name in tables]
    make_folder(folder)
    with writing(folder), ExitStack() as last:
        fresh = [last.enter_context(whole(file)) for file in files]
        for file, (name, rows) in zip(fresh, tables.items(), strict=True):
            lines = [COLUMNS[name], *(",".join(map(str, row)) for row in rows)]
            file.write_text("\n".join(lines) + "\n", encoding="utf-8")
        if not dataset.has_truth:
            (folder / "truth.csv").unlink(missing_ok=True)
    return files
