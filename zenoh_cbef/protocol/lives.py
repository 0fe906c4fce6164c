"""Ids of sessions, and their order: of two processes that hear of each other, Zenoh has the greater one connect.

So they have one link. Ids are made so that the end that connects is the one that more likely reaches the other: first
one that only its own host can reach, then one with private addresses only, then the one that came later.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Sequence
from ipaddress import ip_address

import zenoh

from zenoh_cbef.protocol.addresses import is_loopback, parts

_HIDDEN, _PRIVATE, _PUBLIC = 3, 2, 1
_RANDOM_BYTES, _TIME_BYTES = 8, 7
_LATEST = 12
"""What the first byte of a time stays below until 2077."""
_LEAST, _GREATEST = "0000", "ffff"
"""Ends of the ids of routers: of those that introduce processes, and of those that carry messages."""


def new_life(endpoints: Sequence[str]) -> str:
    """An id for a session that is reached at these endpoints, as Zenoh writes it: the least significant byte first."""
    # Zenoh refuses an id that begins with a zero digit.
    chance = bytes([secrets.randbelow(240) + 16]) + secrets.token_bytes(_RANDOM_BYTES - 1)
    arrival = time.time_ns() // 1000
    return (chance + arrival.to_bytes(_TIME_BYTES, "little") + bytes([_rank(endpoints)])).hex()


def router_life(*, carries: bool) -> str:
    """An id for a router, greatest where it carries messages, least where it only introduces two processes.

    A router remembers all routers that a peer has been linked to, also those that are gone. Only the one with the
    greatest id carries to other sites what that peer sends.
    """
    chance = secrets.token_hex(_RANDOM_BYTES + _TIME_BYTES - 2)
    return f"{secrets.randbelow(15) + 1:x}{chance}0{_GREATEST if carries else _LEAST}"


def site_of(session: zenoh.Session) -> str:
    """The site of a process: the id of the router that it is linked to; "" where it is linked to none."""
    routers = sorted(str(one) for one in session.info.routers_zid() if not str(one).endswith(_LEAST))
    return routers[0] if routers else ""


def is_life(found: str) -> bool:
    """Whether an id was made here: it ends with a time and a rank. Of two thousand others one passes, too."""
    whole = bytes.fromhex(found.zfill(len(found) + len(found) % 2))
    size = _RANDOM_BYTES + _TIME_BYTES + 1
    return len(whole) == size and whole[-1] in {_HIDDEN, _PRIVATE, _PUBLIC} and whole[-2] < _LATEST


def connects(own: str, other: str) -> bool:
    """Whether of two processes the first is the one that connects."""
    first, second = (bytes.fromhex(one.zfill(len(one) + len(one) % 2)) for one in (own, other))
    return int.from_bytes(first, "little") > int.from_bytes(second, "little")


def _rank(endpoints: Sequence[str]) -> int:
    if all(map(is_loopback, endpoints)):
        return _HIDDEN
    return _PRIVATE if all(map(_is_private, endpoints)) else _PUBLIC


def _is_private(endpoint: str) -> bool:
    try:
        return ip_address(parts(endpoint)[1].strip("[]")).is_private
    except ValueError:  # a name
        return False
