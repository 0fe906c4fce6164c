"""Zenoh sessions: opened from a few settings, with every failure as a sentence."""

from __future__ import annotations

import json
import re
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import zenoh

from zenoh_cbef.errors import UserError
from zenoh_cbef.plain import Json
from zenoh_cbef.protocol.access import access_control
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.linger import let_go_at_once
from zenoh_cbef.protocol.messages import LARGEST
from zenoh_cbef.protocol.runtimes import MOST_LINKS, have_room
from zenoh_cbef.protocol.tls import SCHEMES, Tls

_ENDPOINT = re.compile(r"^(tcp|udp|tls|quic|ws|unixsock-stream)/[^\s]+$")
_PORT = re.compile(r":(\d+)$")
_LAST_PORT = 65535
_LOCAL = re.compile(r"^(unixsock-stream/|\w+/(127\.[\d.]+|localhost|\[::1\]):)")
_MEET_SECONDS = 2.0
"""How long a process waits to learn whether a router is at the other end: on a busy machine a link takes a second."""
_MEET_ALL_SECONDS = 0.5
_ROUTER_RETRY_SECONDS = 0.2
_OPEN_MS, _LISTENER_OPEN_MS = 1500, 10_000
"""How long a link may take to open before it is tried again; a session that closes waits for as long.

Longer for processes that listen, of which hundreds link at once: a link whose time is up between the last two steps of
its opening stays in Zenoh's tables, sends, and is never read.
"""
_SCOUT_MS = 20
"""How long Zenoh may hold up the opening of a session for its first link: by default half a second, at random, also
where the link is there. Processes wait for the links that they need themselves."""
_SIZE_LIMIT: Json = {
    "id": "size",
    "flows": ["ingress"],
    "messages": ["put", "query", "reply"],
    "key_exprs": [Keys("*").everything],
    "size_limit": LARGEST,
}
"""Zenoh drops larger messages as they come in, before they fill mailboxes."""


PORT = 7447
"""Where a target, a router or a replay listens that is not told otherwise."""


@dataclass(frozen=True)
class Connection:
    """How a process joins the network.

    connect, listen: endpoints such as tcp/127.0.0.1:7447. mode: peer, client of a router, or router. gossip: the target
    tells a process which others to link to. life: its id (lives.py), None: any. unasked: the program chose what to
    listen on, not its user. detour: a client of the target, which passes on what others say. lease_ms: how long a
    silent link is taken to be alive. config: a Zenoh configuration file that these settings are laid over. tls: links
    with certificates only, and access control by them.
    """

    connect: Sequence[str] = ()
    listen: Sequence[str] = ()
    mode: str = "peer"
    gossip: bool = True
    multicast: bool = False
    lease_ms: int = 5000
    config: str | None = None
    tls: Tls | None = None
    unasked: bool = False
    detour: bool = False
    life: str | None = None

    @property
    def told(self) -> bool:
        """Whether the target tells this process which others to link to."""
        return self.gossip and self.mode == "peer"

    def detour_by(self, endpoint: str) -> Connection:
        """A second connection of the same process, as a client of the target at this endpoint."""
        return replace(self, connect=[endpoint], listen=(), mode="client", gossip=False, life=None, detour=True)

    @property
    def exposed(self) -> list[str]:
        """The endpoints that other hosts can reach and that ask for no certificate."""
        return [one for one in self.listen if not one.startswith(SCHEMES) and not _LOCAL.match(one)]

    def loopback(self, port: int = 0) -> str:
        """An endpoint that no other host can reach; port 0 is any that is free."""
        return f"{SCHEMES[0] if self.tls else 'tcp'}/127.0.0.1:{port}"


class PortInUseError(UserError):
    """Another program listens on a port that this process is to listen on."""


def open_session(connection: Connection, patience: float = 0.0) -> zenoh.Session:
    """As open_joined, of which it returns the first."""
    return open_joined(connection, patience)[0]


def open_joined(
    connection: Connection, patience: float = 0.0, waiting: Callable[[], object] = lambda: None
) -> tuple[zenoh.Session, Connection]:
    """Open a session. Links to endpoints that do not answer yet are made as soon as they do.

    A process that connects to a router and was not told to listen joins as its client: no other host could reach it.
    The connection that is returned says so. A client tries for `patience` s to reach its router, and
    calls `waiting` meanwhile. Raises
    PortInUseError, and UserError for an endpoint that is none, a router that does not answer, or a configuration file
    that Zenoh refuses.
    """
    for endpoint in (*connection.connect, *connection.listen):
        if not _ENDPOINT.match(endpoint) or int((_PORT.search(endpoint) or [0, 0])[1]) > _LAST_PORT:
            raise UserError(f"{endpoint!r} is no endpoint; write it as tcp/HOST:PORT, for example tcp/127.0.0.1:7447")
        if connection.tls and not endpoint.startswith(SCHEMES):
            raise UserError(f"{endpoint} asks for no certificate; with --tls write tls/{endpoint.partition('/')[2]}")
    config = _config(connection)
    have_room()
    zenoh.init_log_from_env_or("off")
    until = time.monotonic() + patience
    while True:
        try:
            session = zenoh.open(config)
        except zenoh.ZError as error:
            unreached = connection.mode == "client" and "connect" in str(error).lower()
            if not unreached or time.monotonic() > until:
                raise _mistake(str(error), connection, unreached=unreached) from None
        else:
            if _met_a_router(session, connection):
                session.close()
                connection = replace(connection, mode="client", listen=())
                config = _config(connection)
                continue
            let_go_at_once(session)
            _meet_all(session, connection)
            return session, connection
        waiting()
        # We wait ourselves, as no signal ends Zenoh's own waiting.
        time.sleep(_ROUTER_RETRY_SECONDS)


def _meet_all(session: zenoh.Session, connection: Connection) -> None:
    """Wait a little for the links to several endpoints: who asks the first one alone does not hear what others say."""
    until = time.monotonic() + _MEET_ALL_SECONDS
    while len(connection.connect) > 1 and time.monotonic() < until:
        if len([*session.info.peers_zid(), *session.info.routers_zid()]) >= len(connection.connect):
            return
        time.sleep(0.01)


def _met_a_router(session: zenoh.Session, connection: Connection) -> bool:
    """Whether a peer that listens nowhere has linked to a router."""
    told = connection.listen and not connection.unasked
    if connection.mode != "peer" or not connection.connect or told or connection.config:
        return False
    until = time.monotonic() + _MEET_SECONDS
    while time.monotonic() < until and not list(session.info.peers_zid()):
        if list(session.info.routers_zid()):
            return True
        time.sleep(0.01)
    return False


def configured_listen(connection: Connection) -> list[str]:
    """The endpoints that the connection's Zenoh configuration file names for a peer to listen on, if any."""
    text = _base(connection.config).get_json("listen/endpoints")
    if text == zenoh.Config().get_json("listen/endpoints"):
        return []
    told = json.loads(text)
    found = told.get("peer", []) if isinstance(told, dict) else told
    return [one for one in (found if isinstance(found, list) else [found]) if isinstance(one, str)]


def configuration(connection: Connection) -> str:
    """The configuration of a session, as JSON that Zenoh's own programs can read, too."""
    return json.dumps(json.loads(str(_config(connection))), indent=1)


def _config(connection: Connection) -> zenoh.Config:
    config = _base(connection.config)
    settings: dict[str, Json] = {
        "mode": connection.mode,
        "scouting/multicast/enabled": connection.multicast,
        "scouting/delay": _SCOUT_MS,
        "scouting/gossip/enabled": connection.gossip,
        # No process tells a peer of third ones, but a router that a process opens for that (introducing.py).
        "scouting/gossip/target": {"router": ["router"], "peer": ["router"]},
        "scouting/gossip/autoconnect": {"router": [], "peer": ["peer"]},
        "scouting/gossip/autoconnect_strategy": {"peer": {"to_router": "always", "to_peer": "greater-zid"}},
        "connect/timeout_ms": 0 if connection.mode == "client" else -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 50, "period_max_ms": 400, "period_increase_factor": 1.5},
        "listen/exit_on_failure": True,
        "transport/link/tx/lease": connection.lease_ms,
        "transport/unicast/open_timeout": _LISTENER_OPEN_MS if connection.listen else _OPEN_MS,
        "transport/unicast/max_sessions": MOST_LINKS,
        "transport/unicast/accept_pending": MOST_LINKS,
        "transport/shared_memory/enabled": False,
        "low_pass_filter": [_SIZE_LIMIT],
    }
    if connection.life is not None:
        settings["id"] = connection.life
    if connection.connect:
        settings["connect/endpoints"] = list(connection.connect)
    listens = config.get_json("listen/endpoints") != zenoh.Config().get_json("listen/endpoints")
    if connection.listen or (connection.mode != "client" and not listens):
        settings["listen/endpoints"] = list(connection.listen) or [connection.loopback()]
    if connection.tls is not None:
        settings["transport/link/tls"] = connection.tls.settings()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config if connection.tls is None else _with_rules(config, access_control(detour=connection.detour))


def _with_rules(config: zenoh.Config, rules: dict[str, Json]) -> zenoh.Config:
    """With access control. Zenoh reads YAML, of which JSON is a part, five times as fast as JSON5."""
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", encoding="utf-8") as file:
        file.write(json.dumps(json.loads(str(config)) | {"access_control": rules}))
        file.flush()
        return zenoh.Config.from_file(file.name)


def _base(path: str | None) -> zenoh.Config:
    if path is None:
        return zenoh.Config()
    if not Path(path).is_file():
        raise UserError(f"there is no Zenoh configuration file {path}")
    try:
        return zenoh.Config.from_file(path)
    except zenoh.ZError as error:
        raise UserError(f"Zenoh refuses {path}: {error}") from None


def _mistake(error: str, connection: Connection, *, unreached: bool) -> UserError:
    """What to tell of an error of Zenoh, which has one type and a text for all."""
    endpoints = ", ".join(connection.listen)
    if unreached:
        if connection.tls is None and (asking := [one for one in connection.connect if one.startswith(SCHEMES)]):
            return UserError(f"{asking[0]} asks for a certificate; give --tls and your folder of 'certs new'")
        routers = ", ".join(connection.connect) or "the endpoints of its configuration"
        return UserError(
            f"neither router nor target answers at {routers}; start 'zenoh-cbef router' there, and check --connect"
            + (", --tls, and that the router's certificate names this host" if connection.tls else "")
        )
    if "in use" in error.lower() or "os error 98" in error.lower():
        return PortInUseError(
            f"a port of {endpoints} is in use; choose another with --listen, or end the process that holds it"
        )
    cause = _last_cause(error)
    if connection.listen and "listen" in error.lower():
        return UserError(f"cannot listen on {endpoints}: {cause}; choose another endpoint with --listen")
    if connection.mode == "router":
        return UserError(
            f"this Zenoh cannot be a router: {cause}; check --config, or install zenohd "
            "(https://zenoh.io/docs/getting-started/installation) and run it with deploy/zenoh/router.json5"
        )
    return UserError(f"Zenoh cannot open a session: {cause}; check --connect and --listen")


def _last_cause(error: str) -> str:
    return re.sub(r" at \S+\.rs:\d+.*", "", error).rsplit(": ", 1)[-1].strip(" !]") or error
