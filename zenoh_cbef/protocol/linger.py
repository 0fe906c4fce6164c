"""Keeps a dead link from holding up all others.

Zenoh closes sockets so that the closing thread waits up to 10 s for unsent data (SO_LINGER; eclipse-zenoh/zenoh#1101).
With a cable out that data never leaves, and the waiting thread serves every other link of the session. Zenoh has no
setting for that, so this module removes the option from every link when it is made: the kernel then sends the rest.
"""

from __future__ import annotations

import socket
import struct

import zenoh

from zenoh_cbef.protocol.sockets import stream_sockets

_OFF = struct.pack("ii", 0, 0)


def let_go_at_once(session: zenoh.Session) -> None:
    """Have every link of a session, present and future, closed without waiting."""
    session.info.declare_link_events_listener(_unset, history=True)


def _unset(event: zenoh.LinkEvent) -> None:
    if event.kind == zenoh.SampleKind.PUT:
        unset_all()


def unset_all() -> None:
    """Have every TCP socket of this process closed without waiting."""
    for copy in stream_sockets():
        copy.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _OFF)
