"""Pieces of HTML that a run's report is made of: tables, definitions, numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from zenoh_cbef import numbers

NOTHING = "n/a"


def number(value: float | None) -> str:
    """As everywhere."""
    return numbers.number(value, nothing=NOTHING)


def ratio(value: float | None, other: float | None) -> float | None:
    """One over the other, where both are."""
    return value / other if value is not None and other else None


def counted(count: int, noun: str) -> str:
    """A number of things."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def definitions(entries: dict[str, str]) -> str:
    """Names and what they are."""
    rows = (f"<dt>{escape(key)}</dt><dd>{escape(value)}</dd>" for key, value in entries.items())
    return f"<dl>{''.join(rows)}</dl>"


def table(caption: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose text is escaped."""
    head = f"<thead><tr>{''.join(f'<th>{escape(cell)}</th>' for cell in heads)}</tr></thead>" if heads else ""
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><caption>{escape(caption)}</caption>{head}<tbody>{body}</tbody></table>"
