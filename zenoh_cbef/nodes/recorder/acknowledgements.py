"""Tells processes that are about to leave that their last words were heard, by liveliness tokens."""

from __future__ import annotations

import threading
import time

from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.recorder.attendance import takes_part
from zenoh_cbef.protocol.tokens import heard_token

_EVERY_SECONDS = 0.1


class Acknowledgements:
    """One token for each sender, for its latest word, and a new one no more than ten times a second.

    So a process that floods its key with words only makes its own token change. Words may come from any
    thread.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._lock = threading.Lock()
        self._words: dict[str, int] = {}
        self._given: dict[str, tuple[int, float]] = {}

    def hear(self, sender: str, word: int | None) -> None:
        """Take a sender's word, and acknowledge it now, or at the next `catch_up`."""
        if word is None or not takes_part(sender, self._node.presence):
            return
        with self._lock:
            self._words[sender] = word
            self._give(sender)

    def catch_up(self) -> None:
        """Acknowledge words that came too soon after others; called every now and then."""
        with self._lock:
            for sender in self._words:
                self._give(sender)

    def _give(self, sender: str) -> None:
        word, now = self._words[sender], time.monotonic()
        given, at = self._given.get(sender, (None, -_EVERY_SECONDS))
        if word == given or now - at < _EVERY_SECONDS:
            return
        self._given[sender] = word, now
        self._node.presence.announce(heard_token(sender, word))
        if given is not None:
            self._node.presence.retract(heard_token(sender, given))
