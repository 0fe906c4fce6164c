"""The fields of messages: each kind is a type, with the test that its values have to pass and their JSON Schema.

A kind of message is a TypedDict of these types; `fields_of` reads the tests from it. So what a reader of the code knows
of a message is what its receivers check.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Annotated, Literal, NotRequired, TypeAlias, TypeGuard, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from zenoh_cbef.plain import Json, flaw
from zenoh_cbef.tracking.moderation import LARGEST_SENT

LONGEST = 10_000
"""Characters of a text, and items of a list or table, beyond which a message is refused."""

FARTHEST = 1e100
"""The largest number in a message, either way: no position, time or variance gets there, and its square is finite."""

START: Literal["start"] = "start"
END: Literal["end"] = "end"
ROUND: Literal["round"] = "round"

_MOST = 1 << 63
_FAR_FUTURE = 1e10
"""A time that is no date, s since the Unix epoch."""

_MOST_COUNTED = 1 << 40
"""The most that one of many counts can be: sums of them stay exact."""

_CONTROL = re.compile("[\\x00-\\x08\\x0b-\\x1f\\x7f]")

_T = TypeVar("_T")
Values: TypeAlias = Sequence[object]
Test = Callable[[Values], bool]


@dataclass(frozen=True)
class Field:
    """One field of a message: a test of its values in some messages, at least one, and its JSON Schema."""

    hold: Test
    schema: Mapping[str, Json]
    optional: bool = False


def are(values: Values, kind: type[_T]) -> TypeGuard[Sequence[_T]]:
    """Whether all values are of a type itself: an integer is no float, a boolean no integer."""
    return set(map(type, values)) <= {kind}


def _counts(values: Values) -> bool:
    return are(values, int) and min(values) >= 0 and max(values) < _MOST


def _small_counts(values: Values) -> bool:
    return are(values, int) and min(values) >= 0 and max(values) < _MOST_COUNTED


def _finite(values: Values) -> bool:
    return (
        are(values, float) and all(map(math.isfinite, values)) and -FARTHEST <= min(values) <= max(values) <= FARTHEST
    )


def _flags(values: Values) -> bool:
    return are(values, bool)


def or_nil(test: Test) -> Test:
    """Values that pass a test, or nil."""

    def hold(values: Values) -> bool:
        known = [value for value in values if value is not None] if None in values else values
        return not known or test(known)

    return hold


def _texts(values: Values) -> bool:
    if not are(values, str) or max(map(len, values)) > LONGEST:
        return False
    # Text that is shown on a terminal must hold no control characters; a list of words can have several lines.
    return all(map(str.isprintable, values)) or not any(map(_CONTROL.search, values))


def _plain_tables(values: Values) -> bool:
    return are(values, dict) and not any(map(flaw, values))


def lists_of(test: Test, size: int | None = None) -> Test:
    """Lists of what passes a test, of a size, or of any that is not absurd."""

    def hold(values: Values) -> bool:
        if not are(values, list):
            return False
        sizes = set(map(len, values))
        flat = [*chain.from_iterable(values)]
        return (max(sizes) <= LONGEST if size is None else sizes == {size}) and (not flat or test(flat))

    return hold


def _doubles(values: Values, most: float = LARGEST_SENT) -> bool:
    if not are(values, bytes) or any(len(value) % 8 for value in values):
        return False
    return bool((np.abs(np.frombuffer(b"".join(values), "<f8")) <= most).all())


def _matrices(values: Values) -> bool:
    return are(values, bytes) and {len(value) for value in values} == {8 * 36} and _doubles(values, FARTHEST)


def _signals(values: Values) -> bool:
    return are(values, str) and {*values} <= {START, END, ROUND}


def _moments(values: Values) -> bool:
    return are(values, float) and _finite(values) and min(values) >= 0.0 and max(values) < _FAR_FUTURE


def _numbers(size: int) -> Field:
    return Field(
        lists_of(_finite, size), {"type": "array", "items": {"type": "number"}, "minItems": size, "maxItems": size}
    )


_INTEGER: Json = {"type": "integer", "minimum": 0}
_DOUBLES: dict[str, Json] = {
    "type": "string",
    "contentEncoding": "binary",
    "description": "little-endian float64",
}

Count = Annotated[int, Field(_counts, {"type": "integer", "minimum": 0})]
SmallCount = Annotated[int, Field(_small_counts, {"type": "integer", "minimum": 0})]
Counts = Annotated[list[int], Field(lists_of(_small_counts), {"type": "array", "items": _INTEGER})]
Flag = Annotated[bool, Field(_flags, {"type": "boolean"})]
Number = Annotated[float, Field(_finite, {"type": "number"})]
NumberOrNil = Annotated[float | None, Field(or_nil(_finite), {"type": ["number", "null"]})]
NumbersOrNil = Annotated[
    list[float | None], Field(lists_of(or_nil(_finite)), {"type": "array", "items": {"type": ["number", "null"]}})
]
Three = Annotated[list[float], _numbers(3)]
Six = Annotated[list[float], _numbers(6)]
Text = Annotated[str, Field(_texts, {"type": "string"})]
Texts = Annotated[list[str], Field(lists_of(_texts), {"type": "array", "items": {"type": "string"}})]
Doubles = Annotated[bytes, Field(_doubles, _DOUBLES)]
DoublesOrNil = Annotated[
    bytes | None,
    Field(or_nil(lambda values: _doubles(values, FARTHEST)), {**_DOUBLES, "type": ["string", "null"]}),
]
Matrix = Annotated[bytes, Field(_matrices, _DOUBLES)]
Table = Annotated[Mapping[str, object], Field(_plain_tables, {"type": "object"})]
Signal = Annotated[Literal["start", "end", "round"], Field(_signals, {"enum": [START, END, ROUND]})]
Moment = Annotated[float, Field(_moments, {"type": "number", "minimum": 0, "exclusiveMaximum": _FAR_FUTURE})]


def field_of(hint: object) -> Field:
    """The test in one of the types above, which a message may lack where it is NotRequired."""
    optional = get_origin(hint) is NotRequired
    field: Field = get_args(get_args(hint)[0] if optional else hint)[1]
    return replace(field, optional=optional)


def fields_of(shape: type) -> dict[str, Field]:
    """The fields of a TypedDict of these types, by name."""
    return {name: field_of(hint) for name, hint in get_type_hints(shape, include_extras=True).items()}
