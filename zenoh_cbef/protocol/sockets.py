"""The sockets of a session's links: Zenoh makes and closes links by itself, and has no call for either."""

from __future__ import annotations

import os
import socket
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import zenoh

_OPEN_FILES = Path("/dev/fd")


def stream_sockets() -> Iterator[socket.socket]:
    """A copy of each TCP socket of this process, which stands for the same connection, and is closed afterwards."""
    for file in _OPEN_FILES.iterdir():
        # Others open and close files meanwhile.
        with suppress(OSError), _copy(int(file.name)) as copy:
            if copy is not None:
                yield copy


@contextmanager
def _copy(number: int) -> Iterator[socket.socket | None]:
    if not stat.S_ISSOCK(os.fstat(number).st_mode):
        yield None
        return
    with socket.socket(fileno=os.dup(number)) as copy:
        is_stream = copy.family in {socket.AF_INET, socket.AF_INET6} and copy.type == socket.SOCK_STREAM
        yield copy if is_stream else None


def links_of(session: zenoh.Session) -> dict[str, list[zenoh.Link]]:
    """The links of a session by the ids of the sessions at their other ends; none where it is closed."""
    found: dict[str, list[zenoh.Link]] = {}
    with suppress(zenoh.ZError):
        for link in session.info.links():
            found.setdefault(str(link.zid), []).append(link)
    return found


def on_link_change(session: zenoh.Session, action: Callable[[str], None]) -> None:
    """Call an action, from a background thread, whenever a link is made or ends, with the id of its other end."""
    session.info.declare_link_events_listener(lambda event: action(str(event.link.zid)))


def end_link(link: zenoh.Link) -> None:
    """Close one TCP link. Zenoh then makes it again only where its own configuration names it."""
    ends = [str(one).partition("/")[2].split("?")[0] for one in (link.src, link.dst)]
    for copy in stream_sockets():
        with suppress(OSError):  # a socket that only listens has no other end
            if [_written(copy.getsockname()), _written(copy.getpeername())] == ends:
                copy.shutdown(socket.SHUT_RDWR)
                return


def _written(address: tuple[str, int] | tuple[str, int, int, int]) -> str:
    host = f"[{address[0]}]" if ":" in address[0] else address[0]
    return f"{host}:{address[1]}"
