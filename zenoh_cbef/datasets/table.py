"""One CSV file of a dataset's folder: its columns as names and numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.errors import UserError
from zenoh_cbef.words import counted

COLUMNS = {"anchors": "id,x,y,z", "ranges": "t,anchor_id,range", "truth": "t,x,y,z"}
"""The header of each file by its name without .csv. truth.csv may be left out."""

_NAMING = frozenset({"id", "anchor_id"})
"""The columns that name an anchor; all others are numbers."""

MOST = {"t": 1e12, "x": 1e7, "y": 1e7, "z": 1e7, "range": 1e7}
"""The largest size of a column's numbers, s and m: that of a scenario's coordinates."""


@dataclass(frozen=True)
class Table:
    """names: the anchor of each row, (r,), empty where no column has one. numbers: the other columns, (r, c)."""

    names: list[str]
    numbers: Floats


def read_table(folder: Path, name: str) -> Table:
    """Read one file of a folder. Raises UserError where it is missing, empty or not as documented."""
    path, columns = folder / f"{name}.csv", COLUMNS[name].split(",")
    rows = _rows(path, COLUMNS[name])
    naming = [place for place, column in enumerate(columns) if column in _NAMING]
    kept = [place for place in range(len(columns)) if place not in naming]
    try:
        numbers = np.array([[float(values[place]) for place in kept] for values in rows])
    except (ValueError, IndexError):
        numbers = None
    if numbers is None or any(len(values) != len(columns) for values in rows) or not np.isfinite(numbers).all():
        flaw = _flaw(path, columns)
        raise UserError(f"{path} has a line that is not {COLUMNS[name]} in finite numbers: {flaw}; correct it")
    for place, values in zip(kept, numbers.T, strict=True):
        column, most = columns[place], MOST[columns[place]]
        if (np.abs(values) > most).any():
            worst = values[np.abs(values).argmax()]
            raise UserError(
                f"{path} has {worst:g} in the column {column}, which takes at most {most:g}, in s or m; correct it"
            )
    written = [values[naming[0]] for values in rows] if naming else []
    labels = {text: _label(text, path) for text in sorted(set(written))}
    return Table([labels[text] for text in written], numbers)


def _rows(path: Path, header: str) -> list[list[str]]:
    if path.is_dir():
        raise UserError(f"{path} is a folder, where a file of {header} has to be; name them otherwise")
    if not path.is_file():
        raise UserError(
            f"{path} is missing; a dataset folder holds anchors.csv and ranges.csv ('zenoh-cbef import' writes them)"
        )
    lines = _lines(path)
    if not lines or lines[0].replace(" ", "") != header:
        raise UserError(
            f"{path} does not begin with the header {header}, with commas between; see docs/datasets.md, "
            "or 'zenoh-cbef import' reads other headers"
        )
    rows = [line.split(",") for line in lines[1:] if line.strip()]
    if not rows:
        raise UserError(f"{path} has no rows; a dataset needs at least one of {header}")
    return rows


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8-sig", errors="replace").replace('"', "").splitlines()


def _label(text: str, path: Path) -> str:
    """An anchor's name: any text, or a number, which has to be whole and means the same however it is written."""
    text = text.strip()
    try:
        value = float(text)
    except ValueError:
        return text
    if value != np.floor(value) or abs(value) > 2**53:
        raise UserError(f"{path} has an anchor id that is not a whole number; correct it, or use names")
    return str(int(value))


def _flaw(path: Path, columns: Sequence[str]) -> str:
    """Where the first line is that does not hold so many finite numbers, and what it holds instead."""
    for number, line in enumerate(_lines(path)[1:], start=2):
        values = line.split(",")
        if line.strip() and len(values) != len(columns):
            return f"line {number} has {counted(len(values), 'value')}"
        for column, value in zip(columns, values if line.strip() else (), strict=False):
            try:
                known = math.isfinite(float("0" if column in _NAMING else value))
            except ValueError:
                known = False
            if not known:
                return f"line {number} has {value.strip()!r:.40}"
    return "a number is written in an unusual way"
