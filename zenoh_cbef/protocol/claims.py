"""Which process has a name: of several processes that claim one name at the same time, the target lets one have it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import zenoh

from zenoh_cbef.protocol.answering import Answering
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.renewing import Renewal
from zenoh_cbef.protocol.session import Connection
from zenoh_cbef.protocol.tokens import can_be_claimed, claim_token

_ASK_SECONDS, _LONGEST_SECONDS = 1.0, 10.0
_AGAIN_SECONDS, _SLOWEST_SECONDS = 0.02, 0.5


class Claims:
    """Gives the name of each agent and recorder to the first process that asks, as long as its claim can be seen.

    A claim is a liveliness token, so it ends with its process, however that ends.
    """

    def __init__(self, presence: Presence) -> None:
        self._presence = presence
        self._holders: dict[str, str] = {}
        self._lock = threading.Lock()

    def given(self, name: str) -> set[str]:
        """The `life` of the process that has a name by our word, if one has: others are of an earlier run."""
        return {self._holders[name]} if name in self._holders else set()

    def holds(self, name: str, life: str) -> bool:
        """Whether a process that is there has a name by our word."""
        return life in self.given(name) and claim_token(name, life) in self._presence

    def holder(self, name: str, life: str) -> str:
        """The `life` of the process that has a name; "" where none has it and the claim of `life` is not seen."""
        with self._lock:
            held = self._holders.get(name, "")
            if claim_token(name, held) not in self._presence:
                # A process of an earlier run of this name will end.
                free = can_be_claimed(name) and name not in self._presence
                held = life if free and claim_token(name, life) in self._presence else ""
            if held:
                self._holders[name] = held
            else:
                self._holders.pop(name, None)
            return held


def serve_claims(session: zenoh.Session, key: str, claims: Claims) -> Answering:
    """Answer which process has a name, until the returned one is undeclared."""

    def reply(query: zenoh.Query) -> None:
        asked = query.parameters
        query.reply(key, claims.holder(asked.get("name") or "", asked.get("life") or ""))

    return Answering(session, key, reply)


def claim(
    session: zenoh.Session,
    claims: str,
    presence: Presence,
    name: str,
    patience: float,
    *,
    connection: Connection,
    stopped: Callable[[], bool] = lambda: False,
) -> bool | None:
    """Claim a name until this session ends. Returns whether it is ours; None if no target says so.

    It asks the target for `patience` s, or until `stopped` says that this process is to end. Where no answer comes over
    the link, it makes the link anew. claims: the key. connection: of the session.

    A claim alone is not a process that takes part, so the claim of a process that does not get the name has no effect.
    """
    life = str(session.zid())
    presence.announce(claim_token(name, life))
    until, pause, renewal = time.monotonic() + patience, _AGAIN_SECONDS, Renewal(session, connection)
    while time.monotonic() < until and not stopped():
        # A process that gives up asks again, which a target that hundreds ask at once would never get over.
        left = min(max(_ASK_SECONDS, until - time.monotonic()), _LONGEST_SECONDS)
        for reply in session.get(f"{claims}?name={name};life={life}", timeout=left):
            if reply.ok is not None and (holder := reply.ok.payload.to_bytes()):
                return holder == life.encode()
        renewal.note_silence()
        time.sleep(pause)
        pause = min(2.0 * pause, _SLOWEST_SECONDS)
    return None
