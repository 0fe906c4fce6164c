"""Why no process answers: whether an endpoint can be reached at all, and which runs are on behind it."""

from __future__ import annotations

import socket
import time
from collections.abc import Sequence
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NotYet
from pathlib import Path
from threading import Thread

import zenoh

from zenoh_cbef.plain import whole
from zenoh_cbef.protocol.keys import Keys, run_of
from zenoh_cbef.protocol.session import Connection

_Place = tuple[
    socket.AddressFamily, socket.SocketKind, int, str, tuple[str, int] | tuple[str, int, int, int] | tuple[int, bytes]
]
"""What a name service says of a place: family, kind and number of the protocol, canonical name, address."""

_REACH_SECONDS = 1.0
_POLL_SECONDS = 0.02
_STREAMS = ("tcp", "tls", "ws")


def linked(session: zenoh.Session) -> bool:
    """Whether a session has a link to any process."""
    return bool(session.info.routers_zid() or session.info.peers_zid())


def wait_for_link(session: zenoh.Session, seconds: float) -> bool:
    """Wait until a session has a link; False after `seconds`."""
    until = time.monotonic() + seconds
    while not linked(session):
        if time.monotonic() > until:
            return False
        time.sleep(_POLL_SECONDS)
    return True


def runs_on(session: zenoh.Session) -> set[str]:
    """The names of all runs whose targets answer now."""
    replies = session.liveliness().get(Keys("*").target_live, timeout=1.0)
    named = (run_of(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None)
    return {run for run in named if run is not None}


def why_no_answer(session: zenoh.Session, connection: Connection, run: str) -> str:
    """Why no process of a run answers, and what to do about it: the second half of a sentence."""
    if linked(session):
        runs = runs_on(session)
        if run in runs:
            allowed = " does this certificate (--tls) allow the question," if connection.tls else ""
            return f"its target is there but says nothing; has it been stopped,{allowed} or is its host overloaded?"
        there = f"there is {', '.join(sorted(runs))}" if runs else "no run is on"
        return f"{there} at {_names(connection)}; check --run, or start 'zenoh-cbef target' first"
    for endpoint in connection.connect:
        if trouble := unreachable(endpoint):
            return trouble
    if not connection.connect:
        return "no other process has linked to this one; give --connect, or start 'zenoh-cbef target' first"
    return (
        f"{_names(connection)} takes connections but does not answer as Zenoh does; "
        "check the port in --connect, and that both ends have --tls or neither"
    )


def _names(connection: Connection) -> str:
    return ", ".join(connection.connect) or "the endpoints of its configuration"


def unreachable(endpoint: str, seconds: float = _REACH_SECONDS) -> str | None:
    """Why an endpoint cannot be reached within `seconds` and what to do about it, None where it can.

    Of protocols without connections only the host's name is looked up.
    """
    protocol, _, rest = endpoint.partition("/")
    place = rest.split("?")[0].split("#")[0]
    if protocol == "unixsock-stream":
        return None if Path(place).exists() else f"there is no socket {place}; check --connect"
    host, _, port = place.rpartition(":")
    host = host.strip("[]")
    number = whole(port)
    if not host or number is None or number > 65535:
        return f"{endpoint} has no host or no port; write it as tcp/HOST:PORT"
    try:
        found = _resolve(host, number, seconds)
    except NotYet:  # an OSError, too
        return f"no name service says which host {host} in {endpoint} is; give its address in --connect"
    except (OSError, UnicodeError):
        return f"{host} in {endpoint} has no address; check the name in --connect, and this host's name service"
    return _refusal(endpoint, found, seconds) if protocol in _STREAMS else None


def _resolve(host: str, port: int, seconds: float) -> Sequence[_Place]:
    # A name service that is away takes longer than a user wants to wait, and cannot be interrupted.
    found: Future[Sequence[_Place]] = Future()

    def ask() -> None:
        try:
            found.set_result(socket.getaddrinfo(host, port, type=socket.SOCK_STREAM))
        except (OSError, UnicodeError) as error:
            found.set_exception(error)

    Thread(target=ask, daemon=True).start()
    return found.result(seconds)


def _refusal(endpoint: str, addresses: Sequence[_Place], seconds: float) -> str | None:
    """Why none of the addresses takes a connection, None where one does."""
    words = ""
    for family, kind, number, _, address in addresses:
        with socket.socket(family, kind, number) as probe:
            probe.settimeout(seconds)
            try:
                probe.connect(address)
            except ConnectionRefusedError:
                words = f"no process listens at {endpoint}; check --connect, and start 'zenoh-cbef target' first"
            except TimeoutError:
                words = f"{endpoint} does not answer; check --connect, that its host is up, and firewalls"
            except OSError as error:
                words = f"{endpoint} cannot be reached ({error.strerror or error}); check --connect and the network"
            else:
                return None
    return words
