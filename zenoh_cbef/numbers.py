"""How numbers are written for people to read, and the shares of steps that errors leave out."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

SKIPPED, MOST_SKIPPED = 0.25, 0.99
"""The share of steps that errors leave out at the start: without a word of the user, and at most."""


def number(value: float | None, unit: str = "", *, nothing: str = "-") -> str:
    """A number in four significant digits; `nothing` where there is none."""
    if value is None or not isfinite(value):
        return nothing
    return f"{value:.4g}" + (f" {unit}" if unit else "")


def written(value: object) -> str:
    """Values of any kind, as in an event's data: numbers as `number` writes them, but with all their whole digits."""
    if isinstance(value, float):
        return f"{value:.0f}" if 1e4 <= abs(value) < 1e16 else number(value, nothing=str(value))
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {written(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(written, value)) + "]"
    return str(value)
