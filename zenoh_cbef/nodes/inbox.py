"""What a process hears from one sender on one key: in order, and no older than wanted."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

from zenoh_cbef.nodes.node import Node
from zenoh_cbef.nodes.rejections import Rejections
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.messages import BadMessage

T = TypeVar("T")
Decoder = Callable[[bytes], tuple[int, int, Any]]


_TICK_SECONDS = 2.0
_ANY = 1 << 63
_PORTION = 2000
_LOOK_UP = 64
"""How many messages are passed over at once, and how many are looked through before a look at the clock."""
_FLIPPED = 8
"""How many bytes of a message are damaged; they begin with the map's size, so no damaged message is well formed."""


class Alarm:
    """Ends a wait at its deadline, and every now and then one without: Zenoh's blocking receive has no timeout."""

    def __init__(self) -> None:
        self._waiting: tuple[float | None, Mailbox] | None = None
        self._armed = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def limit(self, receive: Callable[[], T], mailbox: Mailbox, deadline: float | None) -> T:
        """What a blocking receive of the mailbox gives, woken at the deadline (monotonic s), or every other second."""
        self._waiting = (deadline, mailbox)
        if deadline is not None:
            self._armed.set()
        try:
            return receive()
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


class Inbox:
    """One sender's messages by turn: a number that grows with every message of the key.

    owner: the liveliness name of the sender; open: whether it is there. decode gives a message's turn, sending
    time (ns) and content, or raises BadMessage. horizon: how many turns a sender can be ahead; what claims more is
    forged. patience: how long (s) a sender that is there may keep silent before it is no longer waited for.
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
        alarm: Alarm,
        patience: float,
    ) -> None:
        self.mailbox = mailbox
        self._node, self.owner = node, owner
        self._poll, self._clock = mailbox.poll, node.clock
        self._decode, self._horizon = decode, horizon
        self._rejections, self._alarm, self._patience = rejections, alarm, patience
        self._silent = False
        self._held: tuple[int, Any] | None = None
        self._raw = b""
        self._missed: set[int] = set()
        self.open = True
        self.waited = False
        self.late = 0
        self.delay_ns = self.read = 0
        self._heed(node, owner)

    def _heed(self, node: Node, owner: str) -> None:
        def on_change(name: str, joined: bool) -> None:
            if name == owner:
                # Who comes back joins at a later step than the present one: it has to speak before it is waited for.
                self._silent = joined
                self.open = joined and not node.stopping
                self.mailbox.wake()

        def on_stop() -> None:
            self.open = False
            self.mailbox.wake()

        node.presence.on_change(on_change)
        node.on_stop(on_stop)

    def expect(self, *, there: bool) -> None:
        """From now on wait for the sender, if it is there."""
        self.open, self._silent = there and not self._node.stopping, False

    def next(self, seconds: float) -> Any | None:
        """The next message, whatever its turn, waited for so many seconds; None where none came."""
        until = time.monotonic() + seconds
        while self._held is None and self.open and time.monotonic() < until:
            data = self._poll() or self._alarm.limit(self.mailbox.receive, self.mailbox, until)
            if data is not None:
                self._read(data, _ANY)
        held, self._held = self._held, None
        return None if held is None else held[1]

    def take(self, turn: int, deadline: float | None = None) -> Any | None:
        """The message of a turn, waited for until the deadline (monotonic s; None: as long as its sender lives).

        None where it will not come in time. Older ones are passed over; a later one is kept for its turn.
        """
        until, seen = deadline, 0
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
                    until = self._limit(until)
                    if self.open and not self._silent and time.monotonic() < until:
                        continue
                    # The sender's last words may have come before the news that it left.
                    data = self._poll()
                    if data is None:
                        self._miss(turn, silent=self.open and deadline is None)
                        return None
            self._read(data, turn)
            seen += 1
            # In a flood there is always another message, and so no other end.
            if not seen % _LOOK_UP and (self._silent or time.monotonic() >= (until := self._limit(until))):
                self._miss(turn, silent=deadline is None)
                return None

    def _limit(self, until: float | None) -> float:
        return time.monotonic() + self._patience if until is None else until

    def pass_over(self, turn: int) -> None:
        """Drop what has come up to a turn that is not wanted, or a portion of it."""
        for _ in range(_PORTION):
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

    def _miss(self, turn: int, *, silent: bool) -> None:
        self._missed.add(turn)
        if silent and not self._silent:
            # Waiting for it again would cost as long in every round: it has to speak first.
            self._silent = True
            self._node.event("silent", f"{self.owner} is there but silent; going on without it", owner=self.owner)

    def _pass(self, turn: int) -> None:
        if turn in self._missed:
            self._missed.discard(turn)
            self.late += 1

    def reject(self, reason: str) -> None:
        """Count a message that was taken and then found to be none."""
        self._rejections.add(self.mailbox.key, reason)

    def spoil(self, turn: int, deadline: float | None) -> None:
        """Receive the message of a turn with flipped bytes, so that it must be rejected."""
        if self.take(turn, deadline) is not None:
            self._read(bytes(byte ^ 0xFF for byte in self._raw[:_FLIPPED]) + self._raw[_FLIPPED:], turn)

    def repeat(self, turn: int) -> None:
        """Receive the message of a turn, which was just taken, once more."""
        self._read(self._raw, turn)

    def hold(self, turn: int, deadline: float) -> bool:
        """Wait for the message of a turn and keep it to be taken; False where it is not there at the deadline."""
        content = self.take(turn, deadline)
        if content is None:
            return False
        self._missed.discard(turn)
        self._held = turn, content
        return True

    def _wait(self, deadline: float | None) -> bytes | None:
        self.waited = True
        if not self.open or self._silent:
            return None
        if deadline is not None and time.monotonic() >= deadline:
            return None
        return self._alarm.limit(self.mailbox.receive, self.mailbox, deadline)

    def _read(self, data: bytes, turn: int) -> None:
        try:
            found, sent, content = self._decode(data)
            if found > turn + self._horizon:
                raise BadMessage("ahead of what its sender can have reached")
        except BadMessage as error:
            self.reject(str(error))
        else:
            self._held, self._raw = (found, content), data
            self._silent = False
            self.delay_ns += self._clock() - sent
            self.read += 1
