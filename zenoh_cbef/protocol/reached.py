"""How far a recorder has got: of each agent that it records, the step of the last estimate that it has taken in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress

import msgpack
import zenoh

from zenoh_cbef.protocol.asking import ask_all
from zenoh_cbef.protocol.fields import Counts, field_of
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import VERSION, BadMessage, unpack

_COUNTS = field_of(Counts)


def serve_reached(
    session: zenoh.Session, keys: Keys, name: str, reached: Callable[[], Mapping[int, int]]
) -> zenoh.Queryable[None]:
    """Answer how far a recorder, as in "record/host-b", has got with each agent, until the queryable is undeclared."""
    key = keys.reached(name)

    def reply(query: zenoh.Query) -> None:
        with query:
            steps = dict(reached())
            query.reply(key, msgpack.packb({"v": VERSION, "agents": [*steps], "steps": [*steps.values()]}))

    return session.declare_queryable(key, reply)


def ask_reached(session: zenoh.Session, keys: Keys, seconds: float) -> dict[str, dict[int, int]]:
    """How far each recorder that answers within so many seconds has got with each agent, by the recorders' names."""
    found: dict[str, dict[int, int]] = {}
    for sample in ask_all(session, keys.reached("**"), seconds):
        with suppress(BadMessage):
            found[str(sample.key_expr).removeprefix(keys.reached(""))] = _read(sample.payload.to_bytes())
    return found


def _read(data: bytes) -> dict[int, int]:
    told = unpack(data)
    agents, steps = told.get("agents"), told.get("steps")
    if not isinstance(agents, list) or not isinstance(steps, list) or not _COUNTS.hold([agents, steps]):
        raise BadMessage("it does not tell how far it has got")
    return dict(zip(agents, steps, strict=False))
