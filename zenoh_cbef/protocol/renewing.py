"""Links that are made anew where no answer comes over them.

Of hundreds of links that are made at once, Zenoh now and then leaves one open and mute. A process that has just begun
has one link, to the target or a router. If that one is mute, the process never gets into its run.
"""

from __future__ import annotations

import time

import zenoh

from zenoh_cbef.protocol.addresses import parts
from zenoh_cbef.protocol.session import Connection
from zenoh_cbef.protocol.sockets import end_link, links_of

_MUTE_SECONDS = 10.0
"""How long an answer may take to come, s; each further time twice as long, as the target may have much to do."""


class Renewal:
    """Ends the links that a process makes by its configuration while it has no answer: Zenoh makes them again.

    Only for a process that has no name yet, and whose links no other process therefore misses.
    """

    def __init__(self, session: zenoh.Session, connection: Connection) -> None:
        self._session = session
        self._ports = {parts(one)[2] for one in connection.connect}
        self._patience = _MUTE_SECONDS
        self._due = time.monotonic() + self._patience

    def note_silence(self) -> None:
        """Say that a question has had no answer."""
        if time.monotonic() < self._due:
            return
        for links in links_of(self._session).values():
            for link in links:
                if parts(str(link.dst))[2] in self._ports:
                    end_link(link)
        self._patience *= 2.0
        self._due = time.monotonic() + self._patience
