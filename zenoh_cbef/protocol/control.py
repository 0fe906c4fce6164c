"""Questions and orders to a run that goes on: msgpack maps over a queryable."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgpack
import zenoh

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.messages import VERSION, BadMessage, unpack

Answer = Callable[[dict[str, Any]], dict[str, Any]]


def serve_control(session: zenoh.Session, key: str, answer: Answer) -> zenoh.Queryable[None]:
    """Answer requests until the returned queryable is dropped; a UserError's sentence goes back to who asked."""

    def reply(query: zenoh.Query) -> None:
        with query:
            try:
                request = unpack(b"" if query.payload is None else query.payload.to_bytes())
                if request.get("v") != VERSION:
                    raise BadMessage(f"version {request.get('v')!r:.40}, not {VERSION}")
                said = answer(request)
            except (UserError, BadMessage) as error:
                said = {"error": str(error)}
            query.reply(key, msgpack.packb(said))

    return session.declare_queryable(key, reply)


def ask_control(session: zenoh.Session, key: str, request: dict[str, Any], *, timeout: float) -> dict[str, Any] | None:
    """What the run answers to a request, None where nobody does in time (s). Raises UserError with its sentence."""
    for reply in session.get(key, payload=msgpack.packb({"v": VERSION, **request}), timeout=timeout):
        if reply.ok is None:
            continue
        try:
            said = unpack(reply.ok.payload.to_bytes())
        except BadMessage as error:
            raise UserError(f"{key} answers with something else ({error})") from None
        if "error" in said:
            raise UserError(str(said["error"]))
        return said
    return None
