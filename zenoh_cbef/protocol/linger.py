"""Keeps a dead link from holding up all others.

Zenoh closes sockets so that the closing thread waits up to 10 s for unsent data (SO_LINGER; eclipse-zenoh/zenoh#1101).
With a cable out that data never leaves, and the waiting thread serves every other link of the session. Zenoh has no
setting for that, so this module removes the option from every link when it is made: the kernel then sends the rest.
"""

from __future__ import annotations

import socket
import struct
import threading
import time

import zenoh

from zenoh_cbef.protocol.sockets import stream_sockets

_OFF = struct.pack("ii", 0, 0)
_PAUSE_SECONDS = 0.1
"""How far apart two looks at the sockets are at least: far less than a link can be known to be dead in."""


def let_go_at_once(session: zenoh.Session) -> None:
    """Have every link of a session, present and future, closed without waiting."""
    session.info.declare_link_events_listener(_Unsetting().take, history=True)


class _Unsetting:
    """Looks at all sockets when links are made, but not at each link: the work of n links would grow as n squared."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._due, self._planned = 0.0, False

    def take(self, event: zenoh.LinkEvent) -> None:
        if event.kind != zenoh.SampleKind.PUT:
            return
        with self._lock:
            wait = self._due - time.monotonic()
            if self._planned:
                return
            self._planned = wait > 0.0
        if wait > 0.0:
            timer = threading.Timer(wait, self._unset)
            timer.daemon = True
            timer.start()
        else:
            self._unset()

    def _unset(self) -> None:
        with self._lock:
            self._planned, self._due = False, time.monotonic() + _PAUSE_SECONDS
        unset_all()


def unset_all() -> None:
    """Have every TCP socket of this process closed without waiting."""
    for copy in stream_sockets():
        copy.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _OFF)
