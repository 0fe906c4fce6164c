"""Units of lengths and times, as users say them or headers tell them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation

from zenoh_cbef.datasets.importing.columns import FILES, USUAL, is_column
from zenoh_cbef.errors import UserError

LENGTHS = {"m": "1", "mm": "0.001", "cm": "0.01", "km": "1000", "ft": "0.3048", "in": "0.0254"}
TIMES = {"s": "1", "ms": "0.001", "us": "0.000001", "ns": "0.000000001"}
_SUFFIX = re.compile(r"[\s_(\[]+(mm|cm|km|ft|in|m|s|ms|us|µs|ns|sec|nsec|usec)[\])]?$", re.IGNORECASE)
_SAME = {"µs": "us", "sec": "s", "usec": "us", "nsec": "ns"}
_EPOCHS = (("ns", 1e17), ("us", 1e14), ("ms", 1e11))
"""A unit in which times since 1970 are at least so large; in s they are some 1e9."""


@dataclass(frozen=True)
class Units:
    """What the user says. said: units by "mm" alone ("" as key), by column ("range"), file ("anchors"), or both."""

    said: Mapping[str, str] = field(default_factory=dict)

    def length(self, file: str, column: str, head: str) -> Decimal:
        """What the numbers of a column, with this header, are multiplied by to be m."""
        return Decimal(LENGTHS[self._of(file, column, head, LENGTHS) or "m"])

    def time(self, file: str, head: str, first: Decimal) -> Decimal:
        """What times are multiplied by to be s. first: one of them; times since 1970 tell their unit by their size."""
        told = self._of(file, "t", head, TIMES)
        told = told or next((unit for unit, least in _EPOCHS if abs(first) >= least), "s")
        return Decimal(TIMES[told])

    def _of(self, file: str, column: str, head: str, known: Mapping[str, str]) -> str:
        for key in (f"{file}.{column}", column, file, ""):
            if self.said.get(f"{key}|time" if known is TIMES else f"{key}|length"):
                return self.said[f"{key}|time" if known is TIMES else f"{key}|length"]
        suffix = _SUFFIX.search(head)
        told = _SAME.get(suffix[1].lower(), suffix[1].lower()) if suffix else ""
        return told if told in known else ""


def units_of(words: list[str]) -> Units:
    """From "mm", "range=mm", "anchors=ft", "truth.t=ms". Raises UserError for an unknown unit or column."""
    said = {}
    for word in words:
        key, _, unit = word.rpartition("=")
        if unit not in {**LENGTHS, **TIMES}:
            known = ", ".join([*LENGTHS, *TIMES])
            raise UserError(f"--unit {word}: {unit!r} is no unit; use one of {known}, as in --unit range=mm")
        key = key.strip()
        if key and key not in FILES and not is_column(key):
            names = ", ".join([*USUAL, *FILES])
            raise UserError(f"--unit {word}: {key!r} is no column; the columns and files are {names}, or anchors.x")
        if key and key not in FILES and (key.split(".")[-1] == "t") != (unit in TIMES):
            raise UserError(f"--unit {word}: {key} is no {'time' if unit in TIMES else 'length'}; give another unit")
        said[f"{key}|{'time' if unit in TIMES else 'length'}"] = unit
    return Units(said)


def decimal(text: str) -> Decimal | None:
    """A number as it is written, or the moment of a date (RFC 3339, s since 1970); None for anything else."""
    text = text.strip()
    try:
        value = Decimal(text)
    except InvalidOperation:
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            return None
        return Decimal(str((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()))
    return value if value.is_finite() else None
