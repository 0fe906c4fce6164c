"""The queryable of a replay: `cbef/{run}/replay?pause`, `?rate=2`, `?seek=12.5`, several parted by a semicolon."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgpack
import zenoh

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.answering import Answering
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import VERSION

Orders = list[tuple[str, str]]


def serve_replay(session: zenoh.Session, run: str, obey: Callable[[Orders], Mapping[str, object]]) -> Answering:
    """Answer queries until the returned one is undeclared.

    obey: carries out the orders of a query, (order, value) in their order, and returns the replay's state after them,
    for a msgpack map. Its UserError becomes the reply's error. Called from a thread of its own.
    """
    key = Keys(run).replay

    def reply(query: zenoh.Query) -> None:
        try:
            state = obey(_orders(str(query.parameters)))
        except UserError as error:
            query.reply_err(str(error).encode())
        else:
            query.reply(key, msgpack.packb({"v": VERSION, "run": run, **state}))

    return Answering(session, key, reply)


def _orders(text: str) -> Orders:
    parts = (part.partition("=") for part in text.split(";") if part)
    return [(what, value) for what, _, value in parts]
