"""The links of a process of a run: exactly those that the graph asks for, made and closed while the run goes on."""

from __future__ import annotations

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Collection
from dataclasses import dataclass
from math import inf
from typing import Protocol

from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.protocol.addresses import is_loopback, own_host, reached_at
from zenoh_cbef.protocol.detour import Detour
from zenoh_cbef.protocol.directory import MOST_ENDPOINTS, Place, ask_directory
from zenoh_cbef.protocol.introducing import introduce, life_at
from zenoh_cbef.protocol.keys import agent_named
from zenoh_cbef.protocol.lives import connects, is_life, site_of
from zenoh_cbef.protocol.sockets import end_link, links_of, on_link_change
from zenoh_cbef.protocol.tokens import in_words

_SOON, _LATER, _CALM = 0.25, 2.0, 5.0
"""How often the target is asked, s: at first, while links are missing, and when none is."""
_TRIES = 3
"""After how many tries a process says that it cannot link to another."""
_MOST_CUTS = 3
"""How often a link to the same process is ended: one that its user names with --connect comes back each time."""
_UNHEARD_SECONDS = 5.0
"""How long the name of a process at the other end of a link may take to come, s; each further time twice as long."""


class Near(Protocol):
    """Which agents an agent links to, which can change; on_change is called then."""

    on_change: Callable[[], None]

    def wanted(self) -> Collection[int]:
        """The agents to link to."""
        ...

    def kept(self) -> Collection[int]:
        """The agents to which a link need not be ended."""
        ...


@dataclass
class _Attempts:
    """What became of the wish to link to a process: how often it was tried, when to try again (monotonic s)."""

    tries: int = 0
    again: float = 0.0
    said: bool = False
    why: str = ""


@dataclass
class _Mute:
    """A link over which the name of the process at its other end has not come: how often it was ended, and when to."""

    ends: int = 0
    due: float = inf


class Links:
    """Keeps the links of a process that has its name, in a thread that ends with the process.

    Of two processes one makes their link (`lives.py`). near: which agents an agent links to; None for a process that
    may link to all. Where no link can be made, both ends hear each other through the target (`detour.py`).
    """

    def __init__(self, node: Node, near: Near | None = None) -> None:
        self._near = near
        self._node, self._connection = node, node.connection
        self._name = f"{node.identity.role}/{node.identity.name}"
        self._life = str(node.session.zid())
        self._places: dict[str, Place] = {}
        self._detours: dict[str, bool] = {}
        self._detour = Detour(node.session, node.presence, node.keys, self._name, self._connection)
        self._attempts: defaultdict[str, _Attempts] = defaultdict(_Attempts)
        self._cuts: defaultdict[str, int] = defaultdict(int)
        self._mute: defaultdict[str, _Mute] = defaultdict(_Mute)
        self._changed = threading.Event()

    def keep(self) -> None:
        """Make the links, and keep them from now on."""
        if not self._connection.told:
            return
        on_link_change(self._node.session, self._heed)
        self._node.on_stop(self._changed.set)
        if self._near is not None:
            self._near.on_change = self._changed.set
        self._node.on_close(self._detour.close)
        thread = threading.Thread(target=self._run, daemon=True)
        self._node.await_at_end(thread)
        thread.start()

    def _heed(self, other: str) -> None:
        # Sessions that introduce two processes come and go in great number.
        if is_life(other):
            self._changed.set()

    def _run(self) -> None:
        pause, due = _SOON, 0.0
        while not self._node.stopping:
            self._changed.clear()
            if time.monotonic() >= due:
                news = self._ask()
                pause = _SOON if news else min(2.0 * pause, _LATER if self._lacking() else _CALM)
                due = time.monotonic() + pause
            self._tend()
            self._changed.wait(_SOON if self._lacking() else max(0.0, due - time.monotonic()))

    def _own(self) -> Place:
        # Addresses change: a host moves to another network.
        endpoints = reached_at(self._connection.listen)[:MOST_ENDPOINTS]
        return Place(self._name, self._life, own_host(), tuple(endpoints), site_of(self._node.session))

    def _ask(self) -> bool:
        """Ask the target which others are where; whether it tells anything new."""
        unlinked = [place.name for life, place in self._places.items() if self._attempts[life].said]
        key, former = self._node.keys.links(self._name), (self._places, self._detours)
        told = ask_directory(self._node.session, key, self._own(), unlinked, self._detour.heard())
        if told is not None:
            self._places, self._detours = {place.life: place for place in told.places}, told.detours
        return former != (self._places, self._detours)

    def _wanted(self) -> dict[str, Place]:
        """The processes to link to, of those that are here."""
        if self._near is None:
            return self._places
        near = {None, *self._near.wanted()}
        return {life: place for life, place in self._places.items() if agent_named(place.name) in near}

    def _lacking(self) -> bool:
        unlinked = self._wanted().keys() - links_of(self._node.session).keys()
        return not self._places or not all(self._detours.get(self._places[life].name) for life in unlinked)

    def _tend(self) -> None:
        links = links_of(self._node.session)
        for life, place in self._wanted().items():
            if self._node.stopping:
                return
            if life not in links or place.name in self._node.presence:
                self._mute[life].due = inf
            elif self._is_mute(life):
                end_link(links[life][0])
            if life not in links:
                self._try(place)
                continue
            if self._attempts.pop(life, _Attempts()).said:
                self._node.event("linked", f"{in_words(self._name)} has a link to {in_words(place.name)} now")
        linked = links_of(self._node.session).keys()
        far = {place.name for life, place in self._places.items() if life not in linked}
        self._detour.lead({name: mutual for name, mutual in self._detours.items() if name in far})
        self._cut()

    def _is_mute(self, life: str) -> bool:
        """Whether a link is to end, to be made anew, as the name of the process at its other end does not come.

        Of hundreds of links that are made at once, Zenoh now and then leaves one so. Without its name the other process
        is not there for this one, so nothing is lost with the link.
        """
        mute, now = self._mute[life], time.monotonic()
        if mute.due == inf:
            mute.due = now + _UNHEARD_SECONDS * 2.0**mute.ends
        elif now > mute.due:
            mute.ends, mute.due = mute.ends + 1, inf
            return True
        return False

    def _cut(self) -> None:
        """End links to agents that are no neighbours, or not near any more."""
        if self._near is None:
            return
        links = links_of(self._node.session)
        presence, wanted, kept = self._node.presence, self._near.wanted(), self._near.kept()
        for name, lives in presence.lives(presence.names()).items():
            agent = agent_named(name)
            for life in lives & links.keys():
                if agent in wanted:
                    self._cuts.pop(life, None)
                elif agent is not None and agent not in kept and name != self._name:
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
                f"{in_words(self._name)} has no link to {in_words(place.name)}: "
                f"{attempts.why or 'it listens nowhere'}; the target carries what they tell each other; "
                "to link them, let one listen where the other reaches it (--listen)"
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
