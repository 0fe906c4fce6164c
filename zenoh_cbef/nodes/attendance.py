"""Who of a run is there, as its recorder sees it."""

from __future__ import annotations

import time
from collections.abc import Callable

from zenoh_cbef.nodes.node import Node

_GRACE_SECONDS = 2.0
_LOST_SECONDS = 30.0


class Attendance:
    """Tells who went without a farewell and who came back, and when everybody has left for good.

    tell: puts an event of this kind, text and data into the log; called from a background thread.
    """

    def __init__(self, node: Node, tell: Callable[[str, str, str], None]) -> None:
        self._node, self._tell = node, tell
        self._departed: set[str] = set()
        self._lost: set[str] = set()
        self._seen = False
        self._gone_at: float | None = None
        node.presence.on_change(self._note_change)

    def farewell(self, sender: str) -> None:
        """A process says that it is done."""
        self._departed.add("target/target" if sender == "target" else sender)

    def _note_change(self, name: str, joined: bool) -> None:
        if joined:
            self._departed.discard(name)
        if not name.startswith(("agent/", "target/")) or name in self._departed or self._node.stopping:
            return
        who = name.replace("/", " ") if name.startswith("agent/") else "the target"
        if joined and name in self._lost:
            self._lost.discard(name)
            self._tell("returned", f"{who} is there again", name)
        elif not joined:
            self._lost.add(name)
            self._tell("left", f"{who} is gone without a farewell", name)

    def over(self, *, lacking: bool) -> bool:
        """Whether nobody is there any more; lacking: what they said they sent has not all come.

        Who vanished without a farewell may be behind a broken link, and so may we: they are waited for longer.
        """
        here = any(name.startswith(("agent/", "target/")) for name in self._node.presence.names())
        self._seen |= here
        if here or not self._seen:
            self._gone_at = None
            return False
        self._gone_at = self._gone_at or time.monotonic()
        if self._lost and "target/target" not in self._departed and not self._node.launched:
            return time.monotonic() - self._gone_at > _LOST_SECONDS
        return not lacking or time.monotonic() - self._gone_at > _GRACE_SECONDS
