"""Links that are made while a session is open.

Zenoh connects to endpoints that its configuration names when the session opens, and to processes that it hears of by
gossip. So a process that wants a link opens a second session for a moment, a router that is linked to both ends. The
router tells each end of the other, and they link by themselves. Sessions here take gossip from routers, and give it to
routers, only (`session.py`), so no process hears of a third one in any other way. The router passes on no message: its
access control forbids all.
"""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable
from contextlib import suppress

import zenoh

from zenoh_cbef.plain import Json
from zenoh_cbef.protocol.addresses import parts
from zenoh_cbef.protocol.lives import router_life
from zenoh_cbef.protocol.session import Connection

_REACH_SECONDS = 0.7
_LINK_SECONDS = 2.0
_FIRST_LOOK_SECONDS, _LOOK_SECONDS = 0.001, 0.02
_MUTE: Json = {"enabled": True, "default_permission": "deny", "rules": [], "subjects": [], "policies": []}
_BRIEF: dict[str, Json] = {
    "scouting/multicast/enabled": False,
    "scouting/delay": 0,
    "open/return_conditions": {"connect_scouted": False, "declares": False},
    "connect/exit_on_failure": False,
    "listen/endpoints": [],
    "transport/unicast/open_timeout": 1500,
    "access_control": _MUTE,
}


def life_at(endpoint: str, connection: Connection) -> str:
    """The `life` of the process that listens at an endpoint; "" where none answers as Zenoh does."""
    _, host, port = parts(endpoint)
    try:
        with socket.create_connection((host.strip("[]"), port), _REACH_SECONDS):
            pass
        with _open({"mode": "client", "connect/timeout_ms": 0}, [endpoint], connection) as session:
            return next((str(one) for one in (*session.info.peers_zid(), *session.info.routers_zid())), "")
    except (OSError, zenoh.ZError):
        return ""


def introduce(own: str, other: str, connection: Connection, linked: Callable[[], bool]) -> bool:
    """Have the process that listens at `own`, which is this one, and the one at `other` link. Returns `linked()`."""
    gossip: dict[str, Json] = {
        "mode": "router",
        "id": router_life(carries=False),
        "connect/timeout_ms": -1,
        "connect/retry": {"period_init_ms": 50, "period_max_ms": 400, "period_increase_factor": 1.5},
        "scouting/gossip/enabled": True,
        "scouting/gossip/target": {"router": ["peer"]},
        "scouting/gossip/autoconnect": {"router": []},
    }
    with suppress(zenoh.ZError), _open(gossip, [own, other], connection):
        until, pause = time.monotonic() + _LINK_SECONDS, _FIRST_LOOK_SECONDS
        while not linked() and time.monotonic() < until:
            time.sleep(pause)
            pause = min(2.0 * pause, _LOOK_SECONDS)
    return linked()


def _open(settings: dict[str, Json], connect: list[str], connection: Connection) -> zenoh.Session:
    config = zenoh.Config()
    tls: dict[str, Json] = {}
    if connection.tls is not None:
        tls["transport/link/tls"] = {**connection.tls.settings()}
    for key, value in (_BRIEF | settings | tls | {"connect/endpoints": connect}).items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)
