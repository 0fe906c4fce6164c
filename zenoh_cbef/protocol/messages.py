"""Messages: msgpack maps of an envelope and a body, checked to the letter when they are read.

Envelope: v (protocol version), run, from (the sender, as in "agent/3"), seq (per key, from 0), sent (ns since the
Unix epoch). Numbers and short vectors are plain, so that log viewers can plot them; large arrays are bin fields
of little-endian float64, last in the map.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypedDict

import msgpack
import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.plain import Json
from zenoh_cbef.protocol.fields import LONGEST
from zenoh_cbef.protocol.kinds import Kind, M

VERSION = 1
LARGEST = 1 << 20

# The decoder makes room for as many items as a list claims to have, so that number is limited. No extensions.
_CLAIMS = {"max_array_len": LONGEST, "max_map_len": LONGEST, "max_ext_len": 0}


class BadMessage(ValueError):
    """A message that is not what its key promises; the text says why, in a few words."""


class Schema(TypedDict):
    """A JSON Schema of a message."""

    title: str
    type: str
    properties: dict[str, dict[str, Json]]
    required: list[str]


def json_schema(kind: Kind[M]) -> Schema:
    """The JSON Schema of one kind of message, for logs and readers in other languages."""
    return {
        "title": f"cbef.{kind.name.capitalize()}",
        "type": "object",
        "properties": {name: dict(field.schema) for name, field in kind.fields.items()},
        "required": sorted(kind.required),
    }


def encode(run: str, sender: str, seq: int, sent: int, body: Mapping[str, object]) -> bytes:
    """One message; `body` holds the kind's fields, bin fields last."""
    envelope = {"v": VERSION, "run": run, "from": sender, "seq": seq, "sent": sent}
    return bytes(msgpack.packb({**envelope, **body}))


def unpack(data: bytes) -> dict[str, object]:
    """The map in `data`, unchecked. Raises BadMessage."""
    if len(data) > LARGEST:
        raise BadMessage(f"larger than {LARGEST} bytes")
    try:
        message: object = msgpack.unpackb(data, **_CLAIMS)
    except Exception as error:  # noqa: BLE001 - hostile bytes raise errors of many kinds
        raise BadMessage(f"not msgpack ({type(error).__name__})") from None
    if type(message) is not dict:
        raise BadMessage("not a map")
    return message


def unpack_ours(data: bytes) -> dict[str, object]:
    """The same of a question or an answer of this version of the protocol."""
    found = unpack(data)
    if found.get("v") != VERSION:
        raise BadMessage(f"version {found.get('v')!r:.40}, not {VERSION}")
    return found


def decode(kind: Kind[M], data: bytes, *, run: str, sender: str = "") -> M:
    """Read and check one message. sender: the process that owns the key, "" for any. Raises BadMessage."""
    message: Any = unpack(data)
    # Most messages have the required fields alone: those of one type are then looked at together.
    plain = message.keys() == kind.required
    for hold, names in kind.tests.items():
        plain = plain and hold([*map(message.__getitem__, names)])
    if not plain:
        _check_fields(message, kind)
    _check_origin(message, run, sender)
    checked: M = message
    return checked


def _check_fields(message: Mapping[str, object], kind: Kind[M]) -> None:
    """Raise BadMessage with the first field that is not as promised."""
    for name, value in message.items():
        field = kind.fields.get(name)
        if field is None:
            raise BadMessage(f"unknown field {name!r:.40}")
        if not field.hold([value]):
            raise BadMessage(f"field {name} is not as promised")
    if not kind.required <= message.keys():
        raise BadMessage(f"field {min(kind.required - message.keys())} is missing")


def decode_all(
    kind: Kind[M], messages: Sequence[bytes], *, run: str, sender: str = "", names: Collection[str] | None = None
) -> list[M]:
    """As decode, of many messages at once, in a fraction of the time.

    names: the fields that the caller reads, all where it is None; others need not be as promised. Raises BadMessage
    where any of the messages is not as promised; decode says of one what is wrong.
    """
    maps: Any = [unpack(data) for data in messages]
    fields = kind.fields
    layouts = {frozenset(message) for message in maps}
    for name in frozenset().union(*layouts) if names is None else names:
        values = [message[name] for message in maps if name in message]
        if name not in fields or (values and not fields[name].hold(values)):
            raise BadMessage(f"field {name!r:.40} is not as promised")
    if not all(kind.required <= layout for layout in layouts):
        raise BadMessage("a field is missing")
    for origin in {(message["v"], message["run"], message["from"]) for message in maps}:
        _check_origin(dict(zip(("v", "run", "from"), origin, strict=True)), run, sender)
    checked: list[M] = maps
    return checked


def peek(kind: Kind[M], data: bytes, *, run: str, sender: str) -> int:
    """The step `k` of a message; its other fields need not be as promised. Raises BadMessage."""
    message = unpack(data)
    step = message.get("k")
    if not kind.required <= message.keys() or type(step) is not int or not kind.fields["k"].hold([step]):
        raise BadMessage("field k is missing or not as promised")
    _check_origin(message, run, sender)
    return step


def _check_origin(message: Mapping[str, object], run: str, sender: str) -> None:
    if message["v"] != VERSION:
        raise BadMessage(f"version {message['v']!r:.40}, not {VERSION}")
    if message["run"] != run:
        raise BadMessage(f"of run {message['run']!r:.40}")
    if sender and message["from"] != sender:
        raise BadMessage(f"from {message['from']!r:.40}, not {sender}")


def pack_floats(values: Floats) -> bytes:
    """An array as a bin field."""
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def unpack_floats(data: bytes, *shape: int) -> Floats:
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
