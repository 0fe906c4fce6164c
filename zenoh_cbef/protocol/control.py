"""Questions and orders to a run that goes on: msgpack maps over a queryable."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import msgpack
import zenoh

from zenoh_cbef.errors import UserError
from zenoh_cbef.plain import flaw, read_json
from zenoh_cbef.protocol.messages import COUNT, COUNTS, FARTHEST, LONGEST, TEXT, VERSION, BadMessage, Field, unpack

Answer = Callable[[dict[str, Any]], dict[str, Any]]
Test = Callable[[Any], bool]


def serve_control(session: zenoh.Session, key: str, answer: Answer) -> zenoh.Queryable[None]:
    """Answer requests until the returned queryable is dropped; the asking process gets the sentence of a UserError."""

    def reply(query: zenoh.Query) -> None:
        with query:
            try:
                said = answer(read_request(b"" if query.payload is None else query.payload.to_bytes()))
            except (UserError, BadMessage) as error:
                said = {"error": str(error)}
            query.reply(key, msgpack.packb(said))

    return session.declare_queryable(key, reply)


def read_request(data: bytes) -> dict[str, Any]:
    """A request as a map; its `ask` is a text that says what is asked for. Raises BadMessage."""
    request = unpack(data)
    if request.get("v") != VERSION:
        raise BadMessage(f"version {request.get('v')!r:.40}, not {VERSION}")
    if words := flaw(request):
        raise BadMessage(words)
    if not isinstance(request.get("ask"), str):
        raise BadMessage("it asks for nothing")
    return request


def ask_control(session: zenoh.Session, key: str, request: dict[str, Any], *, timeout: float) -> dict[str, Any] | None:
    """The run's answer to a request; None where none comes within `timeout` s. Raises UserError with its sentence."""
    for reply in session.get(key, payload=msgpack.packb({"v": VERSION, **request}), timeout=timeout):
        if reply.ok is not None:
            return read_answer(reply.ok.payload.to_bytes(), request["ask"], key)
    return None


def read_answer(data: bytes, asked: str, key: str) -> dict[str, Any]:
    """A complete answer, as a map. Raises UserError with the sentence in it, or where a field is missing or wrong."""
    try:
        said = unpack(data)
    except BadMessage as error:
        raise UserError(f"{key} answers with something else ({error})") from None
    if isinstance(said.get("error"), str):
        raise UserError(said["error"])
    for name, holds in _ANSWERS.get(asked, {}).items():
        if name not in said or not holds(said[name]):
            raise UserError(f"{key} answers with something else ({name} is not as promised); is it a zenoh-cbef?")
    return said


def _of(field: Field) -> Test:
    return lambda value: field.hold([value])


def _or_nil(test: Test) -> Test:
    return lambda value: value is None or test(value)


def _flag(value: object) -> bool:
    return isinstance(value, bool)


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _list_of(test: Test) -> Test:
    return lambda value: isinstance(value, list) and len(value) <= LONGEST and all(map(test, value))


def _table(value: object) -> bool:
    return isinstance(value, dict) and not flaw(value)


def _tables(fields: Mapping[str, Test]) -> Test:
    """JSON of a list of tables that have these fields."""

    def holds(text: object) -> bool:
        try:
            tables = read_json(text) if isinstance(text, str) else None
        except ValueError:
            return False
        return isinstance(tables, list) and all(
            isinstance(one, dict) and all(test(one.get(name)) for name, test in fields.items()) for one in tables
        )

    return holds


def _state(value: object) -> bool:
    """A step, and the true state in it."""
    return isinstance(value, list) and len(value) == 2 and _of(COUNT)(value[0]) and _six(value[1])


def _six(value: object) -> bool:
    # The truth is NaN where it is unknown.
    return (
        isinstance(value, list)
        and len(value) == 6
        and all(type(one) is float and not abs(one) > FARTHEST for one in value)
    )


_KIND = {"kind": _of(TEXT)}
_FAULTS = _KIND | {"number": _of(COUNT), "from": _number, "until": _or_nil(_number), "active": _flag}
_MESSAGES = _list_of(lambda value: isinstance(value, bytes))

_ANSWERS: dict[str, dict[str, Test]] = {
    "stop": {"step": _or_nil(_of(COUNT))},
    "fault add": {"number": _of(COUNT), "from": _number},
    "fault clear": {"ended": _of(COUNTS)},
    "fault list": {"faults": _tables(_FAULTS)},
    "status": {
        **dict.fromkeys(("run", "filter", "mode"), _of(TEXT)),
        **dict.fromkeys(("members", "silent", "away"), _of(COUNTS)),
        **dict.fromkeys(("dt", "start", "time"), _number),
        **dict.fromkeys(("planar", "stopping"), _flag),
        **dict.fromkeys(("estimates", "earlier", "cards", "events"), _MESSAGES),
        "agents": lambda value: _of(COUNT)(value) and value <= LONGEST,
        "steps": _of(COUNT),
        "step": _or_nil(_of(COUNT)),
        "target": _table,
        "live": _list_of(_of(TEXT)),
        "truth": _list_of(_state),
        "faults": _tables(_KIND | {"fault": _of(COUNT)}),
    },
}
"""The fields that an answer to each question must have."""
