"""What a process hears from one sender on one key: in order, and no older than wanted."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from zenoh_cbef.nodes.node import Node
from zenoh_cbef.nodes.rejections import Rejections
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.messages import BadMessage

Decoder = Callable[[bytes], tuple[int, int, Any]]


class Alarm:
    """Ends a wait at its deadline: Zenoh's blocking receive has no timeout of its own."""

    def __init__(self) -> None:
        self._waiting: tuple[float, Mailbox] | None = None
        self._armed = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def receive(self, mailbox: Mailbox, deadline: float) -> bytes | None:
        """The mailbox's next message; None at the deadline (monotonic s), or after a wake-up."""
        self._waiting = (deadline, mailbox)
        self._armed.set()
        try:
            return mailbox.receive()
        finally:
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

    owner: the liveliness name of the sender; open: whether it is there. decode gives a message's turn, sending
    time (ns) and content, or raises BadMessage. horizon: how many turns a sender can be ahead; what claims more is
    forged.
    """

    def __init__(
        self,
        node: Node,
        mailbox: Mailbox,
        decode: Decoder,
        *,
        owner: str,
        horizon: int,
        rejections: Rejections,
        alarm: Alarm | None,
    ) -> None:
        self.mailbox = mailbox
        self._poll = mailbox.poll
        self._decode, self._horizon = decode, horizon
        self._rejections, self._alarm = rejections, alarm
        self._held: tuple[int, Any] | None = None
        self._missed: set[int] = set()
        self.open = True
        self.waited = False
        self.late = 0
        self.delay_ns = 0
        self._heed(node, owner)

    def _heed(self, node: Node, owner: str) -> None:
        def on_change(name: str, joined: bool) -> None:
            if name == owner:
                self.open = joined and not node.stopping
                self.mailbox.wake()

        def on_stop() -> None:
            self.open = False
            self.mailbox.wake()

        node.presence.on_change(on_change)
        node.on_stop(on_stop)

    def take(self, turn: int, deadline: float | None = None) -> Any | None:
        """The message of a turn, waited for until the deadline (monotonic s; None: as long as its sender lives).

        None where it will not come in time. Older ones are passed over; a later one is kept for its turn.
        """
        while True:
            if self._held is not None:
                held, content = self._held
                if held > turn:
                    return None
                self._held = None
                if held == turn:
                    return content
                self._pass(held)
            data = self._poll()
            if data is None:
                data = self._wait(deadline)
                if data is None:
                    if self.open and (deadline is None or time.monotonic() < deadline):
                        continue
                    # The sender's last words may have come before the news that it left.
                    data = self._poll()
                    if data is None:
                        self._missed.add(turn)
                        return None
            self._read(data, turn)

    def pass_over(self, turn: int) -> None:
        """Drop what has come up to a turn that is not wanted: a full mailbox would hold up every sender."""
        while True:
            if self._held is not None:
                held, _ = self._held
                if held > turn:
                    return
                self._held = None
                self._pass(held)
            data = self._poll()
            if data is None:
                return
            self._read(data, turn)

    def _pass(self, turn: int) -> None:
        if turn in self._missed:
            self._missed.discard(turn)
            self.late += 1

    def reject(self, reason: str) -> None:
        """Count a message that was taken and then found to be none."""
        self._rejections.add(self.mailbox.key, reason)

    def _wait(self, deadline: float | None) -> bytes | None:
        self.waited = True
        if not self.open:
            return None
        if deadline is None:
            return self.mailbox.receive()
        if time.monotonic() >= deadline:
            return None
        if self._alarm is None:
            raise RuntimeError("an inbox with deadlines needs an alarm")
        return self._alarm.receive(self.mailbox, deadline)

    def _read(self, data: bytes, turn: int) -> None:
        try:
            found, sent, content = self._decode(data)
            if found > turn + self._horizon:
                raise BadMessage("ahead of what its sender can have reached")
        except BadMessage as error:
            self.reject(str(error))
        else:
            self._held = found, content
            self.delay_ns += time.time_ns() - sent
