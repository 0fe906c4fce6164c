"""Messages: msgpack maps of an envelope and a body, checked to the letter when they are read.

Envelope: v (protocol version), run, from (the sender, as in "agent/3"), seq (per key, from 0), sent (ns since the
Unix epoch). Numbers and short vectors are plain, so that log viewers can plot them; large arrays are bin fields
of little-endian float64, last in the map.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.plain import flaw
from zenoh_cbef.tracking import diagnostics
from zenoh_cbef.tracking.moderation import LARGEST_SENT

VERSION = 1
LARGEST = 1 << 20
LONGEST = 10_000
"""Characters of a text, and items of a list or table, beyond which a message is refused."""

# The decoder makes room for as many items as a list claims to have, so that number is limited. No extensions.
_CLAIMS = {"max_array_len": LONGEST, "max_map_len": LONGEST, "max_ext_len": 0}

FARTHEST = 1e100
"""The largest number in a message, either way: no position, time or variance gets there, and its square is finite."""

_MOST = 1 << 63
_FAR_FUTURE = 1e10
"""A time that is no date, s since the Unix epoch."""

_MOST_COUNTED = 1 << 40
"""The most that one of many counts can be: sums of them stay exact."""

_CONTROL = re.compile("[\\x00-\\x08\\x0b-\\x1f\\x7f]")


class BadMessage(ValueError):
    """A message that is not what its key promises; the text says why, in a few words."""


Values = Sequence[Any]
Test = Callable[[Values], bool]


@dataclass(frozen=True)
class Field:
    """One field of a message: a test of its values in some messages, at least one, and its JSON Schema."""

    hold: Test
    schema: Mapping[str, Any]
    optional: bool = False


def _are(values: Values, *types: type) -> bool:
    return set(map(type, values)) <= set(types)


def _counts(values: Values) -> bool:
    return _are(values, int) and min(values) >= 0 and max(values) < _MOST


def _small_counts(values: Values) -> bool:
    return _counts(values) and max(values) < _MOST_COUNTED


def _finite(values: Values) -> bool:
    return (
        _are(values, float) and all(map(math.isfinite, values)) and -FARTHEST <= min(values) <= max(values) <= FARTHEST
    )


def _finite_or_nil(values: Values) -> bool:
    return not (numbers := [value for value in values if value is not None]) or _finite(numbers)


def _texts(values: Values) -> bool:
    if not _are(values, str) or max(map(len, values)) > LONGEST:
        return False
    # Text that is shown on a terminal must hold no control characters; a list of words can have several lines.
    return all(map(str.isprintable, values)) or not any(map(_CONTROL.search, values))


def _plain_tables(values: Values) -> bool:
    return _are(values, dict) and not any(map(flaw, values))


def _lists_of(test: Test, size: int | None = None) -> Test:
    """Lists of what passes a test, of a size, or of any that is not absurd."""

    def hold(values: Values) -> bool:
        if not _are(values, list):
            return False
        sizes = set(map(len, values))
        flat = [*chain.from_iterable(values)]
        return (max(sizes) <= LONGEST if size is None else sizes == {size}) and (not flat or test(flat))

    return hold


def _doubles(values: Values, most: float = LARGEST_SENT) -> bool:
    whole = _are(values, bytes) and all(len(value) % 8 == 0 for value in values)
    return whole and bool((np.abs(np.frombuffer(b"".join(values), "<f8")) <= most).all())


def _doubles_or_nil(values: Values) -> bool:
    return _doubles([value for value in values if value is not None], FARTHEST)


def _numbers(size: int) -> Field:
    return Field(
        _lists_of(_finite, size), {"type": "array", "items": {"type": "number"}, "minItems": size, "maxItems": size}
    )


_INTEGER = {"type": "integer", "minimum": 0}
_DOUBLES = {"type": "string", "contentEncoding": "binary", "description": "little-endian float64"}

COUNT = Field(_counts, _INTEGER)
SMALL_COUNT = Field(_small_counts, _INTEGER)
COUNTS = Field(_lists_of(_small_counts), {"type": "array", "items": _INTEGER})
COUNTS_IF_ANY = replace(COUNTS, optional=True)
NUMBER = Field(_finite, {"type": "number"})
NUMBER_OR_NIL = Field(_finite_or_nil, {"type": ["number", "null"]})
NUMBERS_OR_NIL = Field(_lists_of(_finite_or_nil), {"type": "array", "items": {"type": ["number", "null"]}})
TEXT = Field(_texts, {"type": "string"})
DOUBLES = Field(_doubles, _DOUBLES)
MATRIX = Field(lambda values: _doubles(values, FARTHEST) and {*map(len, values)} == {8 * 36}, _DOUBLES)
DOUBLES_OR_NIL = Field(_doubles_or_nil, {**_DOUBLES, "type": ["string", "null"]})

START, END = "start", "end"
SIGNAL = Field(lambda values: _are(values, str) and {*values} <= {START, END}, {"enum": [START, END]})
MOMENT = Field(
    lambda values: _finite(values) and min(values) >= 0.0 and max(values) < _FAR_FUTURE,
    {"type": "number", "minimum": 0, "exclusiveMaximum": _FAR_FUTURE},
    optional=True,
)

ENVELOPE = {"v": COUNT, "run": TEXT, "from": TEXT, "seq": COUNT, "sent": COUNT}

_EARLY = frozenset({"innovation", "weight"})
"""The diagnostics that logs of version 0.1.0 have; all others are optional."""

BODIES: dict[str, dict[str, Field]] = {
    "truth": {"k": COUNT, "state": _numbers(6)},
    "beacon": {
        "k": COUNT,
        "emitted": NUMBER_OR_NIL,
        "arrived": NUMBER_OR_NIL,
        # In older logs, which have no key for signals.
        "signal": replace(SIGNAL, optional=True),
        "at": MOMENT,
    },
    "signal": {"k": COUNT, "signal": SIGNAL, "at": MOMENT},
    "range": {"k": COUNT, "position": _numbers(3), "range": NUMBER_OR_NIL},
    "round": {"k": COUNT, "l": COUNT, "payload": DOUBLES},
    "estimate": {
        "k": COUNT,
        "state": _numbers(6),
        **{
            name: replace(COUNT if name in diagnostics.WHOLE else NUMBER_OR_NIL, optional=name not in _EARLY)
            for name in diagnostics.NAMES
        },
        "neighbours": COUNTS,
        "received": COUNTS,
        "lost": COUNTS,
        "late": COUNTS,
        "injected_lost": COUNTS_IF_ANY,
        "injected_late": COUNTS_IF_ANY,
        "corrupted": COUNTS_IF_ANY,
        "duplicated": COUNTS_IF_ANY,
        "fates": Field(_lists_of(_texts), {"type": "array", "items": {"type": "string"}}, optional=True),
        "latency": NUMBERS_OR_NIL,
        "covariance": DOUBLES_OR_NIL,
    },
    "smoothed": {"k": COUNT, "until": SMALL_COUNT, "state": _numbers(6), "covariance": MATRIX},
    "faults": {"tables": TEXT},
    "event": {"kind": TEXT, "text": TEXT, "data": Field(_plain_tables, {"type": "object"}, optional=True)},
}

_FIELDS = {kind: {**ENVELOPE, **body} for kind, body in BODIES.items()}
_REQUIRED = {
    kind: frozenset(name for name, field in fields.items() if not field.optional) for kind, fields in _FIELDS.items()
}


def json_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema of one kind of message, for logs and readers in other languages."""
    return {
        "title": f"cbef.{kind.capitalize()}",
        "type": "object",
        "properties": {name: dict(field.schema) for name, field in _FIELDS[kind].items()},
        "required": sorted(_REQUIRED[kind]),
    }


def encode(run: str, sender: str, seq: int, sent: int, body: Mapping[str, Any]) -> bytes:
    """One message; `body` holds the kind's fields, bin fields last."""
    envelope = {"v": VERSION, "run": run, "from": sender, "seq": seq, "sent": sent}
    return bytes(msgpack.packb({**envelope, **body}))


def unpack(data: bytes) -> dict[str, Any]:
    """The map in `data`, unchecked. Raises BadMessage."""
    if len(data) > LARGEST:
        raise BadMessage(f"larger than {LARGEST} bytes")
    try:
        message = msgpack.unpackb(data, **_CLAIMS)
    except Exception as error:  # noqa: BLE001 - hostile bytes raise errors of many kinds
        raise BadMessage(f"not msgpack ({type(error).__name__})") from None
    if type(message) is not dict:
        raise BadMessage("not a map")
    return message


def decode(kind: str, data: bytes, *, run: str, sender: str = "") -> dict[str, Any]:
    """Read and check one message. sender: the process that owns the key, "" for any. Raises BadMessage."""
    message = unpack(data)
    fields = _FIELDS[kind]
    for name, value in message.items():
        field = fields.get(name)
        if field is None:
            raise BadMessage(f"unknown field {name!r:.40}")
        if not field.hold([value]):
            raise BadMessage(f"field {name} is not as promised")
    if not _REQUIRED[kind] <= message.keys():
        raise BadMessage(f"field {min(_REQUIRED[kind] - message.keys())} is missing")
    _check_origin(message, run, sender)
    return message


def decode_all(kind: str, messages: Sequence[bytes], *, run: str, sender: str = "") -> list[dict[str, Any]]:
    """As decode, of many messages at once, in a fraction of the time.

    Raises BadMessage where any of them is not as promised; decode says of one what is wrong.
    """
    maps = [unpack(data) for data in messages]
    fields, required = _FIELDS[kind], _REQUIRED[kind]
    layouts = {frozenset(message) for message in maps}
    for name in frozenset().union(*layouts):
        values = [message[name] for message in maps if name in message]
        if name not in fields or not fields[name].hold(values):
            raise BadMessage(f"field {name!r:.40} is not as promised")
    if not all(required <= layout for layout in layouts):
        raise BadMessage("a field is missing")
    for origin in {(message["v"], message["run"], message["from"]) for message in maps}:
        _check_origin(dict(zip(("v", "run", "from"), origin, strict=True)), run, sender)
    return maps


def peek(kind: str, data: bytes, *, run: str, sender: str) -> dict[str, Any]:
    """As decode, for a reader that needs only the step `k`: the other fields are not checked."""
    message = unpack(data)
    if not _REQUIRED[kind] <= message.keys() or not _counts([message["k"]]):
        raise BadMessage("field k is missing or not as promised")
    _check_origin(message, run, sender)
    return message


def _check_origin(message: dict[str, Any], run: str, sender: str) -> None:
    if message["v"] != VERSION:
        raise BadMessage(f"version {message['v']!r:.40}, not {VERSION}")
    if message["run"] != run:
        raise BadMessage(f"of run {message['run']!r:.40}")
    if sender and message["from"] != sender:
        raise BadMessage(f"from {message['from']!r:.40}, not {sender}")


def pack_floats(values: NDArray[np.float64]) -> bytes:
    """An array as a bin field."""
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def unpack_floats(data: bytes, *shape: int) -> NDArray[np.float64]:
    """A bin field as an array of a shape. Raises BadMessage where the size differs."""
    if len(data) != 8 * math.prod(shape):
        raise BadMessage(f"{len(data)} bytes, not {8 * math.prod(shape)}")
    return np.frombuffer(data, "<f8").reshape(shape).astype(np.float64, copy=False)


def nan_to_nil(value: float) -> float | None:
    """A float for a message, in which there is no NaN."""
    return float(value) if math.isfinite(value) else None


def nil_to_nan(value: float | None) -> float:
    """A message's number, NaN where it has none."""
    return math.nan if value is None else value
