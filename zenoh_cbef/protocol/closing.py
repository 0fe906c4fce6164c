"""Closes a session that may be about to open a link to a process that never answers, as on a host that is down.

Zenoh then waits until the time for that is up (`session.py`). A process must not take that long to end, so its
half-open connections are given up.
"""

from __future__ import annotations

import socket
import threading
from contextlib import suppress

import zenoh

from zenoh_cbef.protocol.addresses import parts
from zenoh_cbef.protocol.session import Connection
from zenoh_cbef.protocol.sockets import links_of, stream_sockets

_PATIENCE_SECONDS = 1.0


def close_soon(session: zenoh.Session, connection: Connection) -> None:
    """Close a session with this connection, and wait for no answer to a link that it is about to make by it."""
    linked = {parts(str(link.src))[2] for links in links_of(session).values() for link in links}
    wanted = {parts(one)[2] for one in connection.connect}
    closed = threading.Event()

    def give_up() -> None:
        while not closed.wait(_PATIENCE_SECONDS):
            for copy in stream_sockets():
                with suppress(OSError):
                    if _is_half_open(copy, linked, wanted):
                        copy.shutdown(socket.SHUT_RDWR)

    thread = threading.Thread(target=give_up, daemon=True)
    thread.start()
    try:
        session.close()
    finally:
        closed.set()
        thread.join()


def _is_half_open(one: socket.socket, linked: set[int], wanted: set[int]) -> bool:
    """Whether a socket is on its way to one of these ports, and is not that of a link, by its own port."""
    if one.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN) or one.getsockname()[1] in linked:
        return False
    try:
        return one.getpeername()[1] in wanted
    except OSError:  # not yet connected
        return True
