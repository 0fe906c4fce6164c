"""Messages of one key expression, received in the caller's thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress

import zenoh

CAPACITY = 512
"""More than one sender can send while its reader is held up for some seconds; older messages are of no use by then."""


class Mailbox:
    """Messages of one key expression in order of arrival, with wake-ups from other threads.

    Zenoh's blocking receive has no timeout: a wake-up is an empty message to ourselves. A full mailbox drops its oldest
    message. If it waited for room, it would hold up everything that its session receives, and a flood on one key would
    stop all others. Senders in step cannot fill the capacity.

    Zenoh uses all places of a mailbox in turn, 256 bytes each: memory grows until the last one was used.
    """

    def __init__(self, session: zenoh.Session, key: str, capacity: int = CAPACITY) -> None:
        self.key = key
        self._session = session
        self._subscriber = session.declare_subscriber(key, zenoh.handlers.RingChannel(capacity))
        self._receive = self._subscriber.handler.recv
        self.sample = self._subscriber.handler.try_recv
        """The next message as Zenoh has it, None where nothing waits: for one who spares a call of `poll`."""
        self._wakes = 0
        self._lock = threading.Lock()

    def receive(self) -> bytes | None:
        """The next message's bytes; None after a wake-up."""
        return self._receive().payload.to_bytes() or self.empty()

    def poll(self) -> bytes | None:
        """As receive, but None at once where nothing waits."""
        sample = self.sample()
        return None if sample is None else sample.payload.to_bytes() or self.empty()

    def receive_from(self) -> tuple[str, bytes] | None:
        """The next message's key and bytes; None after a wake-up."""
        sample = self._receive()
        data = sample.payload.to_bytes() or self.empty()
        return None if data is None else (str(sample.key_expr), data)

    def poll_from(self) -> tuple[str, bytes] | None:
        """As receive_from, but None at once where nothing waits."""
        while (sample := self.sample()) is not None:
            data = sample.payload.to_bytes() or self.empty()
            if data is not None:
                return str(sample.key_expr), data
        return None

    def follow(self, take: Callable[[bytes], None]) -> None:
        """Hand on every message that comes, in the caller's thread, until the session is closed."""
        with suppress(zenoh.ZError):
            while True:
                data = self.receive()
                if data is not None:
                    take(data)

    def close(self) -> None:
        """Take in no more, and forget what has come. No thread may be receiving."""
        with suppress(zenoh.ZError):
            self._subscriber.undeclare()

    def wake(self) -> None:
        """Make a receive in another thread return None."""
        with self._lock:
            self._wakes += 1
        key = self.key.replace("$*", "wake").replace("**", "wake").replace("*", "wake")
        # A closed session has no receiver to wake.
        with suppress(zenoh.ZError):
            self._session.put(key, b"", allowed_destination=zenoh.Locality.SESSION_LOCAL)

    def empty(self) -> bytes | None:
        """None for an empty message that is our own wake-up, otherwise the empty message of a sender."""
        with self._lock:
            if self._wakes:
                self._wakes -= 1
                return None
        return b""
