"""What a process hears of others through the target, where no link to them can be made.

A peer does not pass on to peers what it hears, but it does to its clients. So the process opens a second session, a
client of the target, and hands what that session hears to its first one. Readers of the first session notice no
difference.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from contextlib import suppress
from typing import Protocol

import zenoh

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.asking import ask_all
from zenoh_cbef.protocol.introducing import life_at
from zenoh_cbef.protocol.keys import Keys, agent_named
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.protocol.tokens import heard_token, life_token, over_token

_ASK_SECONDS = 1.0


class _Declared(Protocol):
    def undeclare(self) -> None: ...


class Detour:
    """Hears processes through the target. own: the name of this process, as in "agent/3". connection: its own.

    The second session is open while there are any.
    """

    def __init__(
        self,
        session: zenoh.Session,
        presence: Presence,
        keys: Keys,
        own: str,
        connection: Connection,
    ) -> None:
        self._session, self._presence, self._keys, self._own = session, presence, keys, own
        self._connection = connection
        self._client: zenoh.Session | None = None
        self._closed = False
        self._lock = threading.Lock()
        self._messages: dict[str, list[_Declared]] = {}
        self._tokens: dict[str, list[_Declared]] = {}

    def lead(self, names: Mapping[str, bool]) -> None:
        """From now on hear these processes, as in "agent/3", and no others; each with whether it hears this one, too.

        Only where it does, its name is there for this process: a process that sees another's name may send, and relies
        on being heard.
        """
        with self._lock:
            for name in self._messages.keys() - names.keys():
                for one in self._messages.pop(name) + self._tokens.pop(name, []):
                    one.undeclare()
            if names and self._client is None and not self._closed:
                self._client = self._open_client()
            if self._client is None:
                return
            for name, mutual in names.items():
                self._follow(self._client, name, mutual=mutual)
            if not self._messages:
                self._client.close()
                self._client = None

    def _open_client(self) -> zenoh.Session | None:
        target = self._presence.life("target/target")
        for endpoint in self._connection.connect:
            if life_at(endpoint, self._connection) == target:
                with suppress(UserError):
                    return open_session(self._connection.detour_by(endpoint))
        return None

    def _follow(self, client: zenoh.Session, name: str, *, mutual: bool) -> None:
        if name not in self._messages:
            self._messages[name] = self._hear(client, name)
        if mutual and name not in self._tokens:
            tokens = [heard_token(self._own, "*"), life_token(name, "*"), over_token(name)]
            self._tokens[name] = [self._presence.follow(client, one) for one in tokens]
            # Its name comes last: who sees it may rely on the rest. Each of these comes by a thread of its own.
            self._presence.wait(lambda live: name in self._presence.lives(live), _ASK_SECONDS)
            self._tokens[name].append(self._presence.follow(client, name))

    def heard(self) -> list[str]:
        """The processes that are heard now."""
        return [*self._messages]

    def close(self) -> None:
        """End the second session for good."""
        self._closed = True
        with self._lock:
            if self._client is not None:
                self._client.close()
                self._client = None

    def _hear(self, client: zenoh.Session, name: str) -> list[_Declared]:
        declared: list[_Declared] = []
        for key in self._messages_of(name):
            declared.append(client.declare_subscriber(key, self._hand_on))
            local = zenoh.Locality.SESSION_LOCAL
            declared.append(self._session.declare_queryable(key, self._ask, allowed_origin=local))
        return declared

    def _messages_of(self, name: str) -> list[str]:
        agent = agent_named(name)
        if agent is None:
            return []
        messages = [self._keys.of_agent(agent)]
        # No agent may hear of another's events.
        return messages if agent_named(self._own) is not None else [*messages, self._keys.event(name)]

    def _hand_on(self, sample: zenoh.Sample) -> None:
        with suppress(zenoh.ZError):
            self._session.put(sample.key_expr, sample.payload, allowed_destination=zenoh.Locality.SESSION_LOCAL)

    def _ask(self, query: zenoh.Query) -> None:
        """Ask what the process asks of one that it has no link to."""
        client = self._client
        with query, suppress(zenoh.ZError):
            if client is None:
                return
            for sample in ask_all(client, str(query.selector), _ASK_SECONDS):
                query.reply(sample.key_expr, sample.payload)
