"""Curves in braille characters: two by four points in each place of a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, isfinite, log10

_BLANK = 0x2800
_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
_LABEL = 9


def plot(values: Sequence[float | None], width: int, height: int) -> list[str]:
    """A curve of the latest values on a logarithmic axis, in `height` lines of `width` characters, limits at the left.

    Values that are missing or not positive leave gaps.
    """
    columns = 2 * max(1, width - _LABEL)
    shown = [log10(one) if one is not None and one > 0.0 and isfinite(one) else None for one in values[-columns:]]
    known = [one for one in shown if one is not None]
    if not known:
        return [" " * width] * height
    # Whole halves of decades, so that the axis rests while the curve moves.
    low, high = floor(2 * min(known)) / 2, floor(2 * max(known)) / 2 + 0.5
    cells = [[_BLANK] * (columns // 2) for _ in range(height)]
    before: int | None = None
    for column, value in enumerate(shown):
        if value is None:
            before = None
            continue
        row = min(4 * height - 1, int((high - value) / (high - low) * 4 * height))
        for point in _stroke(row, before):
            cells[point // 4][column // 2] |= _DOTS[column % 2][point % 4]
        before = row
    return [
        f"{label:>{_LABEL - 1}} {''.join(map(chr, line))}"
        for label, line in zip(_labels(low, high, height), cells, strict=True)
    ]


def _stroke(row: int, before: int | None) -> range:
    """The points of one column: up or down to where the one before was, so that the curve hangs together."""
    if before is None or before == row:
        return range(row, row + 1)
    return range(row, before) if row < before else range(before + 1, row + 1)


def _labels(low: float, high: float, height: int) -> list[str]:
    return [f"{10**high:.2g}", *[""] * (height - 2), f"{10**low:.2g}"][:height] if height > 1 else [f"{10**high:.2g}"]
