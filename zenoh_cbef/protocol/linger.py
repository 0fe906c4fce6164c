"""Keeps a dead link from holding up all others.

Zenoh closes sockets so that the closing thread waits up to 10 s for unsent data (SO_LINGER; eclipse-zenoh/zenoh#1101).
With a cable out that data never leaves, and the waiting thread serves every other link of the session. Zenoh has no
setting for that, so this module removes the option from every link when it is made: the kernel then sends the rest.
"""

from __future__ import annotations

import os
import socket
import stat
import struct
from contextlib import suppress
from pathlib import Path

import zenoh

_OPEN_FILES = Path("/dev/fd")
_OFF = struct.pack("ii", 0, 0)


def let_go_at_once(session: zenoh.Session) -> None:
    """Have every link of a session, present and future, closed without waiting."""
    session.info.declare_link_events_listener(_unset, history=True)


def _unset(event: zenoh.LinkEvent) -> None:
    if event.kind == zenoh.SampleKind.PUT:
        for file in _OPEN_FILES.iterdir():
            # Others open and close files meanwhile.
            with suppress(OSError):
                _unset_one(int(file.name))


def _unset_one(number: int) -> None:
    if not stat.S_ISSOCK(os.fstat(number).st_mode):
        return
    # A copy of the descriptor stands for the same socket, and may be closed.
    with socket.socket(fileno=os.dup(number)) as copy:
        if copy.family in {socket.AF_INET, socket.AF_INET6} and copy.type == socket.SOCK_STREAM:
            copy.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _OFF)
