"""What a process hears from one sender on one key: checked, in order, and no older than wanted."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.messages import BadMessage

Decoder = Callable[[bytes], tuple[int, dict[str, Any]]]


class Alarm:
    """Ends a wait at its deadline: Zenoh's blocking receive has no timeout of its own."""

    def __init__(self) -> None:
        self._waiting: tuple[float, Mailbox] | None = None
        self._armed = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def arm(self, deadline: float, mailbox: Mailbox) -> None:
        """Wake the mailbox at a deadline (monotonic s)."""
        self._waiting = (deadline, mailbox)
        self._armed.set()

    def disarm(self) -> None:
        """The wait is over."""
        self._waiting = None

    def _watch(self) -> None:
        while True:
            waiting = self._waiting
            if waiting is None:
                self._armed.wait()
                self._armed.clear()
                continue
            deadline, mailbox = waiting
            left = deadline - time.monotonic()
            if left > 0.0:
                time.sleep(left)
            if self._waiting is waiting:
                self._waiting = None
                mailbox.wake()


class Inbox:
    """One sender's messages by turn: a number that grows with every message of the key.

    decode gives a message's turn and content, or raises BadMessage. horizon: how many turns a sender can be
    ahead; what claims more is forged. alive tells whether the sender is there. on_reject is told why a message
    was dropped.
    """

    def __init__(
        self,
        mailbox: Mailbox,
        decode: Decoder,
        *,
        horizon: int,
        alive: Callable[[], bool],
        on_reject: Callable[[str, str], None],
        alarm: Alarm | None = None,
    ) -> None:
        self.mailbox = mailbox
        self._decode, self._alive, self._on_reject = decode, alive, on_reject
        self._horizon = horizon
        self._alarm = alarm
        self._held: tuple[int, dict[str, Any]] | None = None
        self._missed: set[int] = set()
        self.late = 0
        self.delay_ns = 0

    def take(self, turn: int, deadline: float | None = None) -> dict[str, Any] | None:
        """The message of a turn, waited for until the deadline (monotonic s; None: as long as its sender lives).

        None where it will not come in time. Older ones are passed over; a later one is kept for its turn.
        """
        while True:
            if self._held is not None:
                held, message = self._held
                if held > turn:
                    return None
                self._held = None
                if held == turn:
                    return message
                self._note_late(held)
            data = self._next(deadline)
            if data is None:
                self._missed.add(turn)
                return None
            self._open(data, turn)

    def _note_late(self, turn: int) -> None:
        if turn in self._missed:
            self._missed.discard(turn)
            self.late += 1

    def _open(self, data: bytes, turn: int) -> None:
        try:
            found, message = self._decode(data)
            if found > turn + self._horizon:
                raise BadMessage("ahead of what its sender can have reached")
        except BadMessage as error:
            self._on_reject(self.mailbox.key, str(error))
        else:
            self._held = found, message
            self.delay_ns += time.time_ns() - message["sent"]

    def _next(self, deadline: float | None) -> bytes | None:
        if deadline is not None or not self._alive():
            waiting = self.mailbox.poll_from()
            if waiting is not None:
                return waiting[1]
        while self._alive():
            if deadline is None:
                data = self.mailbox.receive()
            else:
                if time.monotonic() >= deadline:
                    return None
                data = self._receive_until(deadline)
            if data is not None:
                return data
        waiting = self.mailbox.poll_from()
        return None if waiting is None else waiting[1]

    def _receive_until(self, deadline: float) -> bytes | None:
        if self._alarm is None:
            raise RuntimeError("an inbox with deadlines needs an alarm")
        self._alarm.arm(deadline, self.mailbox)
        try:
            return self.mailbox.receive()
        finally:
            self._alarm.disarm()
