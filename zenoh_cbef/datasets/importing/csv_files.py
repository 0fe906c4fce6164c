"""CSV files of ranges, anchors and truth, with any columns, separators and units."""

from __future__ import annotations

import codecs
import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

from zenoh_cbef.datasets.importing.columns import FILES, column_of, refuse_unknown, wide_columns, wide_pattern
from zenoh_cbef.datasets.importing.raw import Place, Raw
from zenoh_cbef.datasets.importing.targets import rows_of, several_targets
from zenoh_cbef.datasets.importing.units import Units, decimal
from zenoh_cbef.errors import UserError
from zenoh_cbef.words import counted, listed

_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@dataclass(frozen=True)
class Sheet:
    """A CSV file: the header's words, and the rows."""

    path: Path
    heads: list[str]
    rows: list[list[str]]


@dataclass
class Reading:
    """One import of CSV files. mapped: headers by meaning; units: what the user says of them.

    only: which rows of ranges are taken in, as "tag=7"; None: all.
    """

    mapped: Mapping[str, str]
    units: Units
    separator: str | None = None
    only: str | None = None
    heads: list[str] = field(default_factory=list)
    """The headers of all files that were read."""

    def read(self, ranges: Path, anchors: Path | None, truth: Path | None) -> Raw:
        """Everything that the files hold. Raises UserError where one cannot be read, or lacks a column."""
        raw = Raw()
        self.read_ranges(ranges, raw)
        if anchors is not None:
            self.read_anchors(anchors, raw)
        if truth is not None:
            self.read_truth(truth, raw)
        refuse_unknown(self.mapped, self.heads)
        return raw

    def read_ranges(self, path: Path, raw: Raw) -> None:
        """Take in a file of ranges: a row each, or a row for each moment and a column for each anchor."""
        sheet = self._sheet(path)
        if self.only is not None:
            sheet = Sheet(path, sheet.heads, rows_of(self.only, sheet.heads, sheet.rows, path.name))
        raw.notes += several_targets(sheet.heads, sheet.rows, path.name)
        wide = wide_columns(sheet.heads, self.mapped)
        at, *others = self._places(["t"] if wide else ["t", "anchor", "range"], sheet, "ranges")
        named = None if wide else others[0]
        cells = wide or {"": others[1]}
        scale = {place: self.units.length("ranges", "range", sheet.heads[place]) for place in cells.values()}
        seconds, unread = self._seconds(sheet, "ranges", at), 0
        for row, time in zip(sheet.rows, seconds, strict=True):
            for label, place in cells.items():
                value = self._number(row, place)
                if value is None or time is None:
                    unread += not wide
                    continue
                name = label if named is None else _name(row[named])
                raw.ranges.append((float(time), name, float(value * scale[place])))
        if not any(time is not None for time in seconds):
            said = f"{sheet.heads[at]} of {path} has no times, as {sheet.rows[0][at]!r}"
            raise UserError(f"{said}; give numbers, or dates as 2024-05-03T09:00:00Z")
        if unread:
            raw.notes.append(f"{counted(unread, 'row')} of {path.name} without a number left out")

    def read_anchors(self, path: Path, raw: Raw) -> None:
        """Take in the places of the anchors."""
        sheet = self._sheet(path)
        named, *_ = self._places(["anchor", "x", "y"], sheet, "anchors")
        for row, place in zip(sheet.rows, self._positions(sheet, "anchors", raw), strict=True):
            if place is None:
                raise UserError(f"{path} has a row without three numbers: {','.join(row):.60}; correct it")
            if _name(row[named]) in raw.anchors:
                raise UserError(f"{path} names anchor {_name(row[named])} twice; give every anchor its own name")
            raw.anchors[_name(row[named])] = place

    def read_truth(self, path: Path, raw: Raw) -> None:
        """Take in the target's true positions."""
        sheet = self._sheet(path)
        at, *_ = self._places(["t", "x", "y"], sheet, "truth")
        seconds = self._seconds(sheet, "truth", at)
        rows = list(zip(seconds, self._positions(sheet, "truth", raw), strict=True))
        raw.truth += [(float(time), place) for time, place in rows if time is not None and place is not None]
        if len(raw.truth) < len(rows):
            raw.notes.append(f"{counted(len(rows) - len(raw.truth), 'row')} of {path.name} without a number left out")

    def _sheet(self, path: Path) -> Sheet:
        try:
            data = path.read_bytes()
        except OSError as error:
            raise UserError(f"cannot read {path}: {error.strerror}; name a CSV file") from None
        if b"\0" in data:
            kind = "UTF-16 text; save it as UTF-8" if data[:2] in _UTF_16 else "no text; name a CSV file"
            raise UserError(f"{path} is {kind}")
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", errors="replace")  # as spreadsheets of Windows write it
        lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(("#", "%"))]
        if len(lines) < 2:
            raise UserError(f"{path} has no rows below a header; name another file")
        separator = self.separator or max(";\t,|", key=lines[0].count)
        if separator not in lines[0]:
            lines, separator = ["\t".join(line.split()) for line in lines], "\t"
        rows = list(csv.reader(lines, delimiter=separator, skipinitialspace=True))
        heads = [head.strip() for head in rows[0]]
        if all(decimal(head) is not None for head in heads if head):
            heads = [str(place) for place in range(1, len(heads) + 1)]  # no header: columns are known by their place
        else:
            del rows[0]
        self.heads += heads
        return Sheet(path, heads, [(row + [""] * len(heads))[: len(heads)] for row in rows])

    def _places(self, meanings: Sequence[str], sheet: Sheet, file: str) -> list[int]:
        """Where the columns of these meanings are. Raises UserError, which names all that are not found."""
        found = [column_of(meaning, sheet.heads, self.mapped, file) for meaning in meanings]
        lacking = [meaning for meaning, place in zip(meanings, found, strict=True) if place is None]
        if lacking:
            asked = "columns are" if lacking[1:] else "column is"
            remedy = " ".join(f"--map {file}.{meaning}=COLUMN" for meaning in lacking)
            heads = ", ".join(sheet.heads)
            if {"anchor", "range"} <= set(lacking) and (pattern := wide_pattern(sheet.heads)):
                remedy += f', or where each anchor has a column of its own --map "range={pattern}"'
            raise UserError(f"{sheet.path}: which {asked} {listed(lacking)}? It has {heads}; say {remedy}")
        return [place for place in found if place is not None]

    @staticmethod
    def _number(row: Sequence[str], place: int) -> Decimal | None:
        text = row[place]
        # Where commas do not separate columns, they may be decimal ones.
        return decimal(text.replace(",", ".") if text.count(",") == 1 else text)

    def _seconds(self, sheet: Sheet, file: str, at: int) -> list[Decimal | None]:
        times = [self._number(row, at) for row in sheet.rows]
        first = next((time for time in times if time is not None), Decimal(0))
        scale = self.units.time(file, sheet.heads[at], first)
        return [None if time is None else time * scale for time in times]

    def _positions(self, sheet: Sheet, file: str, raw: Raw) -> list[Place | None]:
        axes = self._places("xy", sheet, file)
        height = column_of("z", sheet.heads, self.mapped, file)
        if height is None:
            raw.notes.append(f"{sheet.path.name} has no column z: it is taken for 0")
        places = [*axes, *([] if height is None else [height])]
        scale = [self.units.length(file, axis, sheet.heads[place]) for axis, place in zip("xyz", places, strict=False)]
        found: list[Place | None] = []
        for row in sheet.rows:
            values = [self._number(row, place) for place in places]
            known = [float(one * by) for one, by in zip(values, scale, strict=True) if one is not None]
            whole = len(known) == len(places)
            found.append((known[0], known[1], known[2] if height is not None else 0.0) if whole else None)
        return found


def _name(text: str) -> str:
    """An anchor's name; a number means the same however it is written, and commas would part columns."""
    text = text.strip().replace(",", "_")
    value = decimal(text)
    return str(int(value)) if value is not None and value == int(value) else text


def files_of(folder: Path) -> dict[str, Path]:
    """Which CSV file of a folder is which, by their names."""
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in {".csv", ".txt", ".tsv"}:
            name = path.stem.lower()
            known = next((file for file, words in FILES.items() if any(word in name for word in words)), None)
            if known is not None:
                found.setdefault(known, path)
    return found
