"""The links of a process of a run: exactly those that the target names, made and closed while the run goes on."""

from __future__ import annotations

import threading
import time
from collections import defaultdict
from collections.abc import Collection
from dataclasses import dataclass

from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.protocol.addresses import is_loopback, own_host, reached_at
from zenoh_cbef.protocol.directory import MOST_ENDPOINTS, Place, ask_directory
from zenoh_cbef.protocol.introducing import introduce, life_at
from zenoh_cbef.protocol.keys import agent_named
from zenoh_cbef.protocol.lives import connects
from zenoh_cbef.protocol.sockets import end_link, links_of, on_link_change

_SOON, _LATER, _CALM = 0.25, 2.0, 5.0
"""How often the target is asked, s: at first, while links are missing, and when none is."""
_TRIES = 3
"""After how many tries a process says that it cannot link to another."""
_MOST_CUTS = 3
"""How often a link to the same process is ended: one that its user names with --connect comes back each time."""


@dataclass
class _Attempts:
    """What became of the wish to link to a process: how often it was tried, when to try again (monotonic s)."""

    tries: int = 0
    again: float = 0.0
    said: bool = False
    why: str = ""


class Links:
    """Keeps the links of a process that has its name, in a thread that ends with the process.

    Of two processes one makes their link (`lives.py`). neighbours: the agents that an agent exchanges messages with;
    None for a process that may link to all.
    """

    def __init__(self, node: Node, neighbours: Collection[int] | None = None) -> None:
        self._neighbours = neighbours
        self._node, self._connection = node, node.connection
        self._name = f"{node.identity.role}/{node.identity.name}"
        self._life = str(node.session.zid())
        self._wanted: dict[str, Place] = {}
        self._attempts: defaultdict[str, _Attempts] = defaultdict(_Attempts)
        self._cuts: defaultdict[str, int] = defaultdict(int)
        self._changed = threading.Event()

    def keep(self) -> None:
        """Make the links, and keep them from now on."""
        if not self._node.connection.gossip or self._node.connection.mode != "peer":
            return
        on_link_change(self._node.session, self._changed.set)
        self._node.on_stop(self._changed.set)
        thread = threading.Thread(target=self._run, daemon=True)
        self._node.await_at_end(thread)
        thread.start()

    def _run(self) -> None:
        pause, due = _SOON, 0.0
        while not self._node.stopping:
            self._changed.clear()
            if time.monotonic() >= due:
                self._ask()
                due = time.monotonic() + pause
                pause = min(2.0 * pause, _LATER if self._lacking() else _CALM)
            self._tend()
            self._changed.wait(_SOON if self._lacking() else max(0.0, due - time.monotonic()))

    def _own(self) -> Place:
        # Addresses change: a host moves to another network.
        endpoints = reached_at(self._connection.listen)[:MOST_ENDPOINTS]
        return Place(self._name, self._life, own_host(), tuple(endpoints))

    def _ask(self) -> None:
        unlinked = [place.name for life, place in self._wanted.items() if self._attempts[life].said]
        key = self._node.keys.links(self._name)
        told = ask_directory(self._node.session, key, self._own(), tuple(unlinked))
        if told is not None:
            self._wanted = {place.life: place for place in told}

    def _lacking(self) -> bool:
        return bool(self._wanted.keys() - links_of(self._node.session).keys()) or not self._wanted

    def _tend(self) -> None:
        links = links_of(self._node.session)
        for life, place in self._wanted.items():
            if self._node.stopping:
                return
            if life not in links:
                self._try(place)
            elif self._attempts.pop(life, _Attempts()).said:
                self._node.event("linked", f"{_named(self._name)} has a link to {_named(place.name)} now")
        self._cut()

    def _cut(self) -> None:
        """End links to agents that are no neighbours."""
        links, presence = links_of(self._node.session), self._node.presence
        for name, lives in presence.lives(presence.names()).items():
            agent = agent_named(name)
            if agent is None or self._neighbours is None or agent in self._neighbours or name == self._name:
                continue
            for life in lives & links.keys():
                self._cuts[life] += 1
                if self._cuts[life] <= _MOST_CUTS:
                    end_link(links[life][0])

    def _try(self, place: Place) -> None:
        attempts, now = self._attempts[place.life], time.monotonic()
        if not connects(self._life, place.life) or now < attempts.again:
            return
        attempts.tries += 1
        if self._link(place, attempts):
            return
        attempts.again = time.monotonic() + min(0.5 * 2**attempts.tries, 10.0)
        if attempts.tries == _TRIES:
            attempts.said = True
            text = (
                f"{_named(self._name)} has no link to {_named(place.name)}: {attempts.why or 'it listens nowhere'}; "
                "let one of them listen where the other reaches it (--listen), or use a router"
            )
            self._node.event("unlinked", text, other=place.name)

    def _link(self, place: Place, attempts: _Attempts) -> bool:
        """Try the process's endpoints in order."""
        own = self._own()
        ours = next(iter(sorted(own.endpoints, key=is_loopback, reverse=True)), "")
        said = []
        for endpoint in place.endpoints:
            if self._node.stopping or (is_loopback(endpoint) and place.host != own.host):
                continue
            found = life_at(endpoint, self._connection)
            if found == place.life and ours:
                if introduce(ours, endpoint, self._connection, lambda: place.life in links_of(self._node.session)):
                    return True
                said.append(f"{endpoint} does not link")
            else:
                said.append(f"at {endpoint} " + ("another process answers" if found else "no process answers"))
        attempts.why = ", ".join(said)
        return place.life in links_of(self._node.session)


def _named(process: str) -> str:
    role, _, name = process.partition("/")
    return role if role == name else f"{role} {name}"
