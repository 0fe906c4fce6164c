"""Which processes link to each other: each tells the target where it listens, and the target tells it of the others."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import msgpack
import zenoh

from zenoh_cbef.protocol.claims import Claims
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import VERSION, BadMessage, unpack

MOST_ENDPOINTS = 32
_LONGEST = 200
_ANSWER_SECONDS = 1.0
_LIFE = re.compile(r"[0-9a-f]{1,40}")
_ENDPOINT = re.compile(r"(?:tcp|tls|ws)/[^\s/?#]+:[0-9]{1,5}")


@dataclass(frozen=True)
class Place:
    """Where a process can be reached.

    name: as in "agent/3". life: of the process, as its tokens have it. host: the same for processes that reach each
    other on loopback. endpoints: in the order in which to try them.
    """

    name: str
    life: str
    host: str
    endpoints: tuple[str, ...]


class Directory:
    """The places of the processes of a run that have a name by the target's word.

    linked: whether two processes, by their names, are to be linked.
    """

    def __init__(self, claims: Claims, linked: Callable[[str, str], bool]) -> None:
        self._claims, self._linked = claims, linked
        self._places: dict[str, Place] = {}
        self._unlinked: dict[str, tuple[str, ...]] = {}
        self._lock = threading.Lock()

    def tell(self, place: Place, unlinked: tuple[str, ...] = ()) -> list[Place] | None:
        """Take in where a process is, and which others it cannot link to. Returns where those are that it links to.

        None where it does not have its name.
        """
        name = place.name
        if not self._claims.holds(name, place.life):
            return None
        with self._lock:
            self._places[name], self._unlinked[name] = place, unlinked
            others = [one for one in self._places.values() if one.name != name and self._linked(name, one.name)]
        return [one for one in others if self._claims.holds(one.name, one.life)]

    def unlinked(self) -> list[tuple[str, str]]:
        """The pairs of processes that are here and have not found a way to each other."""
        with self._lock:
            here = {name for name, place in self._places.items() if self._claims.holds(name, place.life)}
            pairs = {tuple(sorted((name, one))) for name in here for one in self._unlinked[name] if one in here}
        return sorted((first, second) for first, second in pairs)


def serve_directory(session: zenoh.Session, keys: Keys, directory: Directory) -> zenoh.Queryable[None]:
    """Answer what processes ask of their links, until the returned queryable is dropped."""

    def reply(query: zenoh.Query) -> None:
        with query:
            key = str(query.key_expr)
            name = key.removeprefix(keys.links(""))
            try:
                place, unlinked = _read_question(name, b"" if query.payload is None else query.payload.to_bytes())
            except BadMessage:
                return
            if (told := directory.tell(place, unlinked)) is not None:
                query.reply(key, msgpack.packb({"v": VERSION, "places": [_packed(one) for one in told]}))

    return session.declare_queryable(keys.all_links, reply)


def ask_directory(session: zenoh.Session, key: str, own: Place, unlinked: tuple[str, ...] = ()) -> list[Place] | None:
    """Tell the target where we are. Returns where those are that we link to; None where it does not tell."""
    question = {"v": VERSION, "place": _packed(own), "unlinked": list(unlinked)}
    for reply in session.get(key, payload=msgpack.packb(question), timeout=_ANSWER_SECONDS):
        if reply.ok is not None:
            with suppress(BadMessage):
                return _read_answer(reply.ok.payload.to_bytes())
    return None


def _packed(place: Place) -> list[object]:
    return [place.name, place.life, place.host, list(place.endpoints)]


def _read_question(name: str, data: bytes) -> tuple[Place, tuple[str, ...]]:
    asked = _unpack(data)
    place, unlinked = _place(asked.get("place")), asked.get("unlinked")
    if place.name != name:
        raise BadMessage("it speaks for another process")
    return place, _texts(unlinked)


def _read_answer(data: bytes) -> list[Place]:
    places = _unpack(data).get("places")
    if not isinstance(places, list):
        raise BadMessage("it tells no places")
    return [_place(one) for one in places]


def _unpack(data: bytes) -> dict[str, object]:
    found = unpack(data)
    if found.get("v") != VERSION:
        raise BadMessage(f"version {found.get('v')!r:.40}, not {VERSION}")
    return dict(found)


def _place(told: object) -> Place:
    if not isinstance(told, list) or len(told) != 4:
        raise BadMessage("a place is not as promised")
    name, life, host = _texts(told[:3])
    endpoints = _texts(told[3])
    few = len(endpoints) <= MOST_ENDPOINTS
    if not few or not _LIFE.fullmatch(life) or not all(map(_ENDPOINT.fullmatch, endpoints)):
        raise BadMessage("a place is not as promised")
    return Place(name, life, host, endpoints)


def _texts(told: object) -> tuple[str, ...]:
    if not isinstance(told, list) or not all(isinstance(one, str) and len(one) <= _LONGEST for one in told):
        raise BadMessage("a list is not as promised")
    return tuple(told)
