"""Messages: msgpack maps of an envelope and a body, checked to the letter when they are read.

Envelope: v (protocol version), run, from (the sender, as in "agent/3"), seq (per key, from 0), sent (ns since the
Unix epoch). Numbers and short vectors are plain, so that log viewers can plot them; large arrays are bin fields
of little-endian float64, last in the map.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

VERSION = 1
LARGEST = 1 << 20
_MOST = 1 << 63


class BadMessage(ValueError):
    """A message that is not what its key promises; the text says why, in a few words."""


@dataclass(frozen=True)
class Field:
    """One field of a message: a test of its value and its JSON Schema."""

    holds: Callable[[Any], bool]
    schema: Mapping[str, Any]
    optional: bool = False


def _count(value: Any) -> bool:
    return type(value) is int and 0 <= value < _MOST


def _number(value: Any) -> bool:
    return type(value) is float and math.isfinite(value)


def _number_or_nil(value: Any) -> bool:
    return value is None or _number(value)


def _text(value: Any) -> bool:
    return type(value) is str and len(value) <= 10_000


def _floats(size: int) -> Callable[[Any], bool]:
    return lambda value: type(value) is list and len(value) == size and all(map(_number, value))


def _list_of(test: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: type(value) is list and len(value) <= 10_000 and all(map(test, value))


def _doubles(value: Any) -> bool:
    return type(value) is bytes and len(value) % 8 == 0 and bool(np.isfinite(np.frombuffer(value, "<f8")).all())


def _numbers(size: int) -> Field:
    return Field(_floats(size), {"type": "array", "items": {"type": "number"}, "minItems": size, "maxItems": size})


_INTEGER = {"type": "integer", "minimum": 0}
_DOUBLES = {"type": "string", "contentEncoding": "binary", "description": "little-endian float64"}

COUNT = Field(_count, _INTEGER)
COUNTS = Field(_list_of(_count), {"type": "array", "items": _INTEGER})
COUNTS_IF_ANY = replace(COUNTS, optional=True)
NUMBER = Field(_number, {"type": "number"})
NUMBER_OR_NIL = Field(_number_or_nil, {"type": ["number", "null"]})
NUMBERS_OR_NIL = Field(_list_of(_number_or_nil), {"type": "array", "items": {"type": ["number", "null"]}})
TEXT = Field(_text, {"type": "string"})
DOUBLES = Field(_doubles, _DOUBLES)
DOUBLES_OR_NIL = Field(lambda value: value is None or _doubles(value), {**_DOUBLES, "type": ["string", "null"]})

ENVELOPE = {"v": COUNT, "run": TEXT, "from": TEXT, "seq": COUNT, "sent": COUNT}

DISTRUST = "distrust"
"""Field of an estimate that says how far the agent distrusted its own range."""

BIAS = ("bias", "bias_std", "bias_weight")
"""Fields of an estimate that say what is estimated of the constant error of the agent's ranges."""

BODIES: dict[str, dict[str, Field]] = {
    "truth": {"k": COUNT, "state": _numbers(6)},
    "beacon": {
        "k": COUNT,
        "emitted": NUMBER_OR_NIL,
        "arrived": NUMBER_OR_NIL,
        "signal": Field(lambda value: value in ("start", "end"), {"enum": ["start", "end"]}, optional=True),
        "at": Field(_number, {"type": "number"}, optional=True),
    },
    "range": {"k": COUNT, "position": _numbers(3), "range": NUMBER_OR_NIL},
    "round": {"k": COUNT, "l": COUNT, "payload": DOUBLES},
    "estimate": {
        "k": COUNT,
        "state": _numbers(6),
        "innovation": NUMBER_OR_NIL,
        "weight": NUMBER_OR_NIL,
        # Optional, as logs of version 0.1.0 lack them.
        "nis": Field(_number_or_nil, NUMBER_OR_NIL.schema, optional=True),
        "nis_degrees": Field(_count, _INTEGER, optional=True),
        **{name: Field(_number_or_nil, NUMBER_OR_NIL.schema, optional=True) for name in (DISTRUST, *BIAS)},
        "neighbours": COUNTS,
        "received": COUNTS,
        "lost": COUNTS,
        "late": COUNTS,
        "injected_lost": COUNTS_IF_ANY,
        "injected_late": COUNTS_IF_ANY,
        "corrupted": COUNTS_IF_ANY,
        "duplicated": COUNTS_IF_ANY,
        "fates": Field(_list_of(_text), {"type": "array", "items": {"type": "string"}}, optional=True),
        "latency": NUMBERS_OR_NIL,
        "covariance": DOUBLES_OR_NIL,
    },
    "faults": {"tables": TEXT},
    "event": {
        "kind": TEXT,
        "text": TEXT,
        "data": Field(lambda value: type(value) is dict, {"type": "object"}, optional=True),
    },
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
        message = msgpack.unpackb(data)
    except Exception as error:  # noqa: BLE001 - hostile bytes raise errors of many kinds
        raise BadMessage(f"not msgpack ({type(error).__name__})") from None
    if type(message) is not dict:
        raise BadMessage("not a map")
    return message


def decode(kind: str, data: bytes, *, run: str, sender: str = "") -> dict[str, Any]:
    """Read and check one message. sender: who owns the key, "" for anybody. Raises BadMessage."""
    message = unpack(data)
    fields = _FIELDS[kind]
    for name, value in message.items():
        field = fields.get(name)
        if field is None:
            raise BadMessage(f"unknown field {name!r:.40}")
        if not field.holds(value):
            raise BadMessage(f"field {name} is not as promised")
    if not _REQUIRED[kind] <= message.keys():
        raise BadMessage(f"field {min(_REQUIRED[kind] - message.keys())} is missing")
    _check_origin(message, run, sender)
    return message


def peek(kind: str, data: bytes, *, run: str, sender: str) -> dict[str, Any]:
    """As decode, for a reader that wants only the step `k`: the other fields are not looked into."""
    message = unpack(data)
    if not _REQUIRED[kind] <= message.keys() or not _count(message["k"]):
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
