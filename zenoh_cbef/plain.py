"""Values from other processes: which of them are accepted, and readers of JSON and TOML texts that hold them.

Python's own readers accept texts that overflow its stack or keep it busy for hours. Here the length of a text and the
depth of a value are limited.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import TypeAlias

Json: TypeAlias = "Mapping[str, Json] | Sequence[Json] | str | float | bool | None"
"""What JSON can say."""

MOST_CHARACTERS = 1 << 20
"""The longest text: a scenario has to fit into a message."""

DEEPEST = 32
"""The most levels of nested tables and lists."""

_LEAST_INTEGER, _MOST_INTEGER = -(1 << 63), (1 << 64) - 1
_WHOLE = re.compile("[0-9]{1,18}")
_TOO_DEEP = f"it nests more than {DEEPEST} levels deep"
# The time that TOML's reader takes for a dotted key grows with the square of its parts.
_LONG_KEY = re.compile(rf"""(?<![\w-])(?>(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{DEEPEST}}}""", re.ASCII)


def flaw(value: object) -> str:
    """Why a value is not plain, in a few words; "" for one that is.

    A plain value is one that JSON can hold: tables with text for names, lists, text, true and false, null, finite
    numbers and integers of 64 bits, nested at most DEEPEST levels deep.
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


def read_json(text: str | bytes) -> Json:
    """A plain value from JSON. Raises ValueError with the reason in a few words."""
    _check_length(text)
    try:
        value: Json = json.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    if words := flaw(value):
        raise ValueError(words)
    return value


def read_toml(text: str) -> dict[str, object]:
    """The tables of a TOML text. Raises ValueError with the reason in a few words."""
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
    """The whole number in a text of one to eighteen ASCII digits, None for any other text."""
    return int(text) if _WHOLE.fullmatch(text) else None


def count_in(table: Mapping[str, object], name: str) -> int | None:
    """The count of that name in a table; None where the value is no count, as other processes may send any value."""
    value = table.get(name)
    return value if type(value) is int and value >= 0 else None


def counts_in(table: Mapping[str, object], name: str) -> dict[str, int]:
    """The counts in the table of that name, without values that are no counts; empty where there is no such table."""
    value = table.get(name)
    counts = value if isinstance(value, dict) else {}
    return {each: count for each in counts if (count := count_in(counts, each)) is not None}
