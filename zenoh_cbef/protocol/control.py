"""Questions and orders to a run that goes on: msgpack maps over a queryable."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgpack
import zenoh

from zenoh_cbef.errors import UserError
from zenoh_cbef.plain import flaw
from zenoh_cbef.protocol.answering import Answering
from zenoh_cbef.protocol.messages import VERSION, BadMessage, unpack, unpack_ours
from zenoh_cbef.protocol.questions import Answer, Question

Request = dict[str, object]
"""What a process asks for: `ask`, a text, and what belongs to that question."""


def serve_control(session: zenoh.Session, key: str, answer: Callable[[Request], Mapping[str, object]]) -> Answering:
    """Answer requests until the returned one is undeclared; the asking process gets the sentence of a UserError."""

    def reply(query: zenoh.Query) -> None:
        data = b"" if query.payload is None else query.payload.to_bytes()
        try:
            said: Mapping[str, object] = answer(read_request(data))
        except (UserError, BadMessage) as error:
            said = {"error": str(error)}
        query.reply(key, msgpack.packb(said))

    return Answering(session, key, reply)


def read_request(data: bytes) -> Request:
    """A request as a map; its `ask` is a text that says what is asked for. Raises BadMessage."""
    request = unpack_ours(data)
    if words := flaw(request):
        raise BadMessage(words)
    if not isinstance(request.get("ask"), str):
        raise BadMessage("it asks for nothing")
    return request


def ask_control(
    session: zenoh.Session, key: str, question: Question[Answer], *, timeout: float, **more: object
) -> Answer | None:
    """The run's answer to a question; None where none comes within `timeout` s. Raises UserError with its sentence."""
    request = {"v": VERSION, "ask": question.name, **more}
    for reply in session.get(key, payload=msgpack.packb(request), timeout=timeout):
        if reply.ok is not None:
            return read_answer(reply.ok.payload.to_bytes(), question, key)
    return None


def read_answer(data: bytes, question: Question[Answer], key: str) -> Answer:
    """A complete answer. Raises UserError with the sentence in it, or where a field is missing or wrong."""
    try:
        said = unpack(data)
    except BadMessage as error:
        raise UserError(f"{key} answers with something else ({error})") from None
    if isinstance(sentence := said.get("error"), str):
        raise UserError(sentence)
    for name, field in question.fields.items():
        if name in said and field.hold([said[name]]):
            continue
        if name in said or not field.optional:
            raise UserError(f"{key} answers with something else ({name} is not as promised); is it a zenoh-cbef?")
    return question.known(said)
