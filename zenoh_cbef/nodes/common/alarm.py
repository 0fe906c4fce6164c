"""Ends waits that have no timeout."""

from __future__ import annotations

import threading
import time

from zenoh_cbef.protocol.mailbox import Mailbox

_TICK_SECONDS = 2.0


class Alarm:
    """Ends a wait at its deadline, or, without one, every other second: Zenoh's blocking receive has no timeout."""

    def __init__(self) -> None:
        self._waiting: tuple[float | None, Mailbox] | None = None
        self._armed = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def receive(self, mailbox: Mailbox, deadline: float | None) -> bytes | None:
        """The mailbox's next message; None after a wake-up, at the deadline (monotonic s) or every other second."""
        self._waiting = (deadline, mailbox)
        if deadline is not None:
            self._armed.set()
        try:
            return mailbox.receive()
        finally:
            self._waiting = None

    def receive_from(self, mailbox: Mailbox) -> tuple[str, bytes] | None:
        """As receive, without a deadline, with the message's key."""
        self._waiting = (None, mailbox)
        try:
            return mailbox.receive_from()
        finally:
            self._waiting = None

    def _watch(self) -> None:
        while True:
            waiting = self._waiting
            if waiting is not None and waiting[0] is not None:
                time.sleep(max(0.0, waiting[0] - time.monotonic()))
            elif self._armed.wait(_TICK_SECONDS):
                self._armed.clear()
                continue
            if waiting is not None and self._waiting is waiting:
                self._waiting = None
                waiting[1].wake()
