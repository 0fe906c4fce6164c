"""Values that others sent: what of them is read, and JSON and TOML texts that hold them.

Python's own readers take what overruns its stack or keeps it busy for hours. Here every text has a length, every value
a depth.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping
from typing import Any

MOST_CHARACTERS = 1 << 20
"""Of a text: a scenario has to fit a message."""

DEEPEST = 32
"""Levels of tables and lists in one another."""

_LEAST_INTEGER, _MOST_INTEGER = -(1 << 63), (1 << 64) - 1
_WHOLE = re.compile("[0-9]{1,18}")
_TOO_DEEP = f"it nests more than {DEEPEST} levels deep"
# The time that TOML's reader takes for a dotted key grows with the square of its parts.
_LONG_KEY = re.compile(rf"""(?<![\w-])(?>(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{DEEPEST}}}""", re.ASCII)


def flaw(value: object) -> str:
    """Why a value is not plain, in a few words; "" for one that is.

    Plain is what JSON can say: tables with text for names, lists, text, true and false, nothing, finite numbers and
    integers of 64 bits, at most DEEPEST levels in one another.
    """
    waiting: list[tuple[object, int]] = [(value, 0)]
    while waiting:
        one, depth = waiting.pop()
        if isinstance(one, dict | list):
            if depth == DEEPEST:
                return _TOO_DEEP
            parts = [*one, *one.values()] if isinstance(one, dict) else one
            if isinstance(one, dict) and not all(isinstance(name, str) for name in one):
                return "a table has a name that is no text"
            waiting += [(part, depth + 1) for part in parts]
        elif words := _flaw_of_one(one):
            return words
    return ""


def _flaw_of_one(value: object) -> str:
    if isinstance(value, str):
        return "" if value.isascii() or _is_unicode(value) else "it holds text that is not valid Unicode"
    if isinstance(value, float):
        return "" if math.isfinite(value) else "it holds a number that is not finite"
    if isinstance(value, int):
        return "" if _LEAST_INTEGER <= value <= _MOST_INTEGER else "it holds a number of too many digits"
    return "" if value is None else f"it holds a {type(value).__name__}"


def _is_unicode(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def read_json(text: str | bytes) -> Any:
    """A plain value from JSON. Raises ValueError, which says in a few words why it is none."""
    _check_length(text)
    try:
        value = json.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    if words := flaw(value):
        raise ValueError(words)
    return value


def read_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text. Raises ValueError, which says in a few words why it has none."""
    _check_length(text)
    if _LONG_KEY.search(text):
        raise ValueError(_TOO_DEEP)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None


def _check_length(text: str | bytes) -> None:
    if len(text) > MOST_CHARACTERS:
        raise ValueError(f"it is longer than {MOST_CHARACTERS} characters")


def whole(text: str) -> int | None:
    """The number that up to eighteen ASCII digits stand for, None for any other text."""
    return int(text) if _WHOLE.fullmatch(text) else None


def count_in(table: Mapping[str, object], name: str) -> int | None:
    """The count of that name in a table, None where it has none: anything may stand there."""
    value = table.get(name)
    return value if type(value) is int and value >= 0 else None


def counts_in(table: Mapping[str, object], name: str) -> dict[str, int]:
    """The table of counts of that name in a table, without what is no count; empty where there is none."""
    value = table.get(name)
    counts = value if isinstance(value, dict) else {}
    return {each: count for each in counts if (count := count_in(counts, each)) is not None}
