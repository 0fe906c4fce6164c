"""From a dataset to a folder."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.layout import COLUMNS
from zenoh_cbef.errors import UserError


def write_dataset(dataset: Dataset, folder: Path) -> list[Path]:
    """Write a recorded set; returns its files. Every number reads back as it was.

    A truth.csv that is there, where the dataset has no truth, goes: it would be another recording's. Raises UserError
    where the folder cannot be written.
    """
    labels = dataset.labels
    tables: dict[str, Iterable[Sequence[object]]] = {
        "anchors": [(label, *row) for label, row in zip(labels, dataset.anchors.tolist(), strict=True)],
        "ranges": [
            (time, labels[anchor], distance)
            for time, anchor, distance in zip(
                dataset.range_time.tolist(), dataset.range_anchor.tolist(), dataset.ranges.tolist(), strict=True
            )
        ],
    }
    if dataset.has_truth:
        known = zip(dataset.truth_time.tolist(), dataset.truth.tolist(), strict=True)
        tables["truth"] = [(time, *row) for time, row in known]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not dataset.has_truth:
            (folder / "truth.csv").unlink(missing_ok=True)
        for name, rows in tables.items():
            lines = [COLUMNS[name], *(",".join(map(str, row)) for row in rows)]
            (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise UserError(f"cannot write {folder}: {error.strerror}; choose another --output") from None
    return [folder / f"{name}.csv" for name in tables]
