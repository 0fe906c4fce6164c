"""Which processes link to each other: each tells the target where it listens, and the target tells it of the others."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import msgpack
import zenoh

from zenoh_cbef.protocol.answering import Answering
from zenoh_cbef.protocol.claims import Claims
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import VERSION, BadMessage, unpack_ours

MOST_ENDPOINTS = 32
_LONGEST = 200
_ANSWER_SECONDS = 10.0
"""Long: an answer that comes after its question was given up costs the target as much, and the process asks again."""
_LIFE = re.compile(r"[0-9a-f]{1,40}")
_ENDPOINT = re.compile(r"(?:tcp|tls|ws)/[^\s/?#]+:[0-9]{1,5}")


@dataclass(frozen=True)
class Place:
    """Where a process can be reached.

    name: as in "agent/3". life: of the process, as its tokens have it. host: the same for processes that reach each
    other on loopback. endpoints: in the order in which to try them. site: the same for processes that are linked to the
    same router, "" for those that are linked to none.
    """

    name: str
    life: str
    host: str
    endpoints: tuple[str, ...]
    site: str = ""

    def shares_site(self, other: Place) -> bool:
        """Whether a link between the two is of use: routers carry what processes of two sites tell each other."""
        return self.site == other.site or not (self.site and other.site)


@dataclass(frozen=True)
class Told:
    """What the target tells a process: where those are that it links to, and which of them it hears on a detour.

    detours: by their names, with whether they hear it on theirs.
    """

    places: list[Place]
    detours: dict[str, bool]


@dataclass(frozen=True)
class Apart:
    """Two processes that have found no way to each other. carried: the target carries what they tell each other."""

    first: str
    second: str
    carried: bool


class Directory:
    """The places of the processes of a run that have a name by the target's word.

    linked: whether two processes, by their names, are to be linked.
    """

    def __init__(self, claims: Claims, linked: Callable[[str, str], bool]) -> None:
        self._claims, self._linked = claims, linked
        self._places: dict[str, Place] = {}
        self._near: dict[str, list[str]] = {}
        self._unlinked: dict[str, tuple[str, ...]] = {}
        self._heard: dict[str, tuple[str, ...]] = {}
        self._lock = threading.Lock()

    def tell(self, place: Place, unlinked: tuple[str, ...] = (), heard: tuple[str, ...] = ()) -> Told | None:
        """Take in where a process is, which others it cannot link to, and which it hears on a detour.

        None where it does not have its name.
        """
        name = place.name
        if not self._claims.holds(name, place.life):
            return None
        with self._lock:
            self._meet(name)
            self._places[name], self._unlinked[name], self._heard[name] = place, unlinked, heard
            others = [self._places[one] for one in self._near[name]]
            others = [one for one in others if one.shares_site(place)]
            far = [one.name for one in others if one.name in unlinked or name in self._unlinked[one.name]]
            detours = {one: name in self._heard[one] for one in far}
        return Told([one for one in others if self._claims.holds(one.name, one.life)], detours)

    def _meet(self, name: str) -> None:
        """Note whom a process that is new here is to be linked to: once, as there are many that ask often."""
        if name not in self._near:
            self._near[name] = [one for one in self._near if self._linked(name, one)]
            for one in self._near[name]:
                self._near[one].append(name)

    def apart(self) -> list[Apart]:
        """The pairs of processes that are here and have found no way to each other."""
        with self._lock:
            here = {name for name, place in self._places.items() if self._claims.holds(name, place.life)}
            pairs = {(min(name, one), max(name, one)) for name in here for one in self._unlinked[name] if one in here}
            heard = self._heard
            return [Apart(one, two, two in heard[one] and one in heard[two]) for one, two in sorted(pairs)]


def serve_directory(session: zenoh.Session, keys: Keys, directory: Directory) -> Answering:
    """Answer what processes ask of their links, until the returned one is undeclared."""

    def reply(query: zenoh.Query) -> None:
        key = str(query.key_expr)
        name = key.removeprefix(keys.links(""))
        try:
            asked = _read_question(name, b"" if query.payload is None else query.payload.to_bytes())
        except BadMessage:
            return
        if (told := directory.tell(*asked)) is not None:
            places = [_packed(one) for one in told.places]
            query.reply(key, msgpack.packb({"v": VERSION, "places": places, "detours": told.detours}))

    return Answering(session, keys.all_links, reply)


def ask_directory(
    session: zenoh.Session, key: str, own: Place, unlinked: Sequence[str] = (), heard: Sequence[str] = ()
) -> Told | None:
    """Tell the target where we are, and so on as `Directory.tell`. Returns what it tells; None where it does not."""
    question = {"v": VERSION, "place": _packed(own), "unlinked": [*unlinked], "heard": [*heard]}
    with suppress(zenoh.ZError):  # the process ends
        for reply in session.get(key, payload=msgpack.packb(question), timeout=_ANSWER_SECONDS):
            if reply.ok is not None:
                with suppress(BadMessage):
                    return _read_answer(reply.ok.payload.to_bytes())
    return None


def _packed(place: Place) -> list[object]:
    return [place.name, place.life, place.host, list(place.endpoints), place.site]


def _read_question(name: str, data: bytes) -> tuple[Place, tuple[str, ...], tuple[str, ...]]:
    asked = unpack_ours(data)
    place = _place(asked.get("place"))
    if place.name != name:
        raise BadMessage("it speaks for another process")
    return place, _texts(asked.get("unlinked")), _texts(asked.get("heard"))


def _read_answer(data: bytes) -> Told:
    told = unpack_ours(data)
    places, detours = told.get("places"), told.get("detours")
    if not isinstance(places, list) or not isinstance(detours, dict):
        raise BadMessage("it tells no places")
    return Told([_place(one) for one in places], {one: detours[one] is True for one in _texts([*detours])})


def _place(told: object) -> Place:
    if not isinstance(told, list) or len(told) != 5:
        raise BadMessage("a place is not as promised")
    name, life, host, site = _texts([*told[:3], told[4]])
    endpoints = _texts(told[3])
    few = len(endpoints) <= MOST_ENDPOINTS
    known = _LIFE.fullmatch(life) and (not site or _LIFE.fullmatch(site))
    if not few or not known or not all(map(_ENDPOINT.fullmatch, endpoints)):
        raise BadMessage("a place is not as promised")
    return Place(name, life, host, endpoints, site)


def _texts(told: object) -> tuple[str, ...]:
    if not isinstance(told, list) or not all(isinstance(one, str) and len(one) <= _LONGEST for one in told):
        raise BadMessage("a list is not as promised")
    return tuple(told)
