"""The messages of one sender on one key: in order, and no older than the reader needs."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeAlias, TypeVar

from zenoh_cbef.nodes.common.alarm import Alarm
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.rejections import Rejections
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.memory import ask_since
from zenoh_cbef.protocol.messages import BadMessage

Content = TypeVar("Content")
Decoder: TypeAlias = Callable[[bytes], tuple[int, int, int, Content]]
"""Step, round (0 where there are none), sending time (ns) and content of a message; raises BadMessage."""

_ANY = 1 << 63
_PORTION = 2000
_LOOK_UP = 64
"""How many messages are passed over at once, and how many are looked through before a look at the clock."""
_REMEMBERED = 4096
"""How many of a sender's missed messages are known, to tell late ones from lost ones."""
SILENT, MISSED = "silent", "missed"
"""Kinds of the events that say that a process in lockstep goes on without a message that was due."""
_FLIPPED = 8
"""How many bytes of a message are damaged; they begin with the map's size, so no damaged message is well formed."""


class Stopped(Exception):
    """The process was told to stop while it waited in lockstep: the caller must not conclude the present step."""


class Inbox(Generic[Content]):
    """One sender's messages by turn: a number that grows with every message of the key.

    owner: the liveliness name of the sender; open: whether it is there. turns: how many a step has; where there are
    more than one, the first belongs to the ranges, which have a key of their own, and rounds count from 1. horizon: how
    many turns a sender can be ahead; what claims more is forged. patience: how long (s) a sender that is there may keep
    silent before it is no longer waited for; grace: likewise for one that is out of sight, behind a link that may come
    back.

    In lockstep (no deadline) the inbox waits for a message that is due, and asks for one that it may have missed.
    `_give_up` alone decides to go on without it, and reports that in an event. lost: messages missed of a sender that
    is there; late: those of them that came after all.
    """

    def __init__(
        self,
        node: Node,
        mailbox: Mailbox,
        decode: Decoder[Content],
        *,
        owner: str,
        horizon: int,
        turns: int,
        rejections: Rejections,
        alarm: Alarm,
        patience: float,
        grace: float,
    ) -> None:
        self.mailbox = mailbox
        self._node, self.owner = node, owner
        self._sample, self._clock = mailbox.sample, node.clock
        self._decode, self._horizon, self._turns = decode, horizon, turns
        self._first = 1 if turns > 1 else 0
        self._rejections, self._alarm = rejections, alarm
        self._patience, self._grace = patience, grace
        self._silent, self._unheard, self._broke_silence, self._life = False, True, False, ""
        self._gone_at, self._since = time.monotonic(), 0.0
        self._held: tuple[int, Content] | None = None
        self._raw, self._end = b"", _ANY
        self._recalled: deque[bytes] = deque()
        self._missed: dict[int, None] = {}  # in the order of time
        self.on_recall: Callable[[], None] = lambda: None
        self.open, self.waited = True, False
        self.lost = self.late = self.delay_ns = self.read = 0
        self._heed(node, owner)

    def _heed(self, node: Node, owner: str) -> None:
        def on_change(name: str, joined: bool) -> None:
            if name == owner:
                self._gone_at = time.monotonic()
                if joined and not self._grace:
                    # A sender that comes back joins at a later step than the present one: we wait for it again only
                    # after its first message.
                    self._silent = self._unheard = True
                self.open = joined and not node.stopping
                self.mailbox.wake()

        def on_stop() -> None:
            self.open = False
            self.mailbox.wake()

        node.presence.on_change(on_change)
        node.on_stop(on_stop)

    def expect(self, *, there: bool) -> None:
        """From now on wait for the sender, if it is there, also where it is another process than before."""
        self.open, self._silent = there and not self._node.stopping, False
        self._unheard, self._life = True, ""

    def end(self, turn: int) -> None:
        """Know that this turn and all after it will not come; from any thread."""
        self._end = turn
        self.mailbox.wake()

    def next(self, seconds: float) -> Content | None:
        """The next message, whatever its turn, waited for so many seconds; None where none came."""
        until = time.monotonic() + seconds
        while self._held is None and self.open and time.monotonic() < until:
            data = self._poll() or self._alarm.receive(self.mailbox, until)
            if data is not None:
                self._read(data, _ANY)
        held, self._held = self._held, None
        return None if held is None else held[1]

    def take(self, turn: int, deadline: float | None = None) -> Content | None:
        """The message of a turn, waited for until the deadline (monotonic s; None: lockstep, as long as it can come).

        None where it will not come in time. Older ones are passed over; a later one is kept for its turn. Raises
        Stopped where the process is to stop in lockstep.
        """
        self._since, seen, asked = 0.0, 0, False
        while True:
            if self._held is not None:
                held, content = self._held
                if held > turn:
                    if asked or deadline is not None or self._silent:
                        self._give_up(turn, deadline, "did not get a message through")
                        return None
                    asked = True
                    self._recall(turn)
                    continue
                self._held = None
                if held == turn:
                    return content
                self._pass(held)
            if self._recalled:
                data: bytes | None = self._recalled.popleft()
            else:  # As in _poll, without a call: this is the innermost loop.
                sample = self._sample()
                data = None if sample is None else sample.payload.to_bytes() or self.mailbox.empty()
            if data is None:
                data = self._await(turn, deadline)
                if data is None:
                    return None
            self._read(data, turn)
            seen += 1
            # In a flood there is always another message, and so no other end.
            if not seen % _LOOK_UP and (hopeless := self._hopeless(turn, deadline)):
                self._give_up(turn, deadline, hopeless)
                return None

    def _await(self, turn: int, deadline: float | None) -> bytes | None:
        """The next message, waited for; None where none can come any more, and the turn's is given up."""
        while True:
            self.waited = True
            reachable = self.open or (self._grace and deadline is None and not self._node.stopping)
            timely = deadline is None or time.monotonic() < deadline
            hopes = turn < self._end and not self._silent and reachable and timely
            if hopes and (data := self._alarm.receive(self.mailbox, deadline)) is not None:
                return data
            if hopeless := self._hopeless(turn, deadline):
                # The sender's last words may have come before the news that it left.
                if (data := self._poll()) is None:
                    self._give_up(turn, deadline, hopeless)
                return data
            if deadline is None and self.open:
                self._recall(turn)
                if (data := self._poll()) is not None:
                    return data

    def _hopeless(self, turn: int, deadline: float | None) -> str:
        """Why a message is not waited for any longer, "" where it is."""
        now, presence = time.monotonic(), self._node.presence
        if turn >= self._end:
            return "has said that it is over"
        if deadline is not None:
            return "" if self.open and not self._silent and now < deadline else "is late"
        self._since = self._since or now
        if self._node.stopping:
            raise Stopped
        if self._silent:
            return "has not spoken again"
        if not self._unheard and presence.life(self.owner) != self._life:
            return "was started again"
        if self.open:
            return "" if now < self._since + self._patience else "is there but silent"
        hope = not presence.is_over(self.owner) and now < self._gone_at + self._grace
        return "" if hope else "is not there any more"

    def _give_up(self, turn: int, deadline: float | None, why: str) -> None:
        """Go on without a message that is due. In lockstep that is not planned, so an event reports it.

        One event is enough: from then on the sender has to send again before we wait for it.
        """
        if turn >= self._end:
            return
        self.miss(turn)
        if deadline is None and not self._silent:
            self._silent = self._unheard = True
            step, round_ = divmod(turn, self._turns)
            kind = SILENT if "silent" in why else MISSED
            text = f"{self.owner} {why}; going on without it from step {step}"
            self._node.event(kind, text, owner=self.owner, step=step, round=round_)

    def miss(self, turn: int) -> None:
        """Count a message as lost, unless its sender is not there: such a sender sends nothing."""
        if self.open and turn not in self._missed:
            self._missed[turn] = None
            if len(self._missed) > _REMEMBERED:
                del self._missed[next(iter(self._missed))]
            self.lost += 1

    def _recall(self, turn: int) -> None:
        """Ask the sender for its messages since a turn: a link that broke has lost those that were on their way."""
        self.on_recall()
        found = ask_since(self._node.session, self.mailbox.key, turn // self._turns)
        if self._held is not None:
            found.append(self._raw)
            self._held = None
        self._recalled = deque([*found, *self._recalled])

    def _poll(self) -> bytes | None:
        return self._recalled.popleft() if self._recalled else self.mailbox.poll()

    def pass_over(self, turn: int) -> None:
        """Drop messages up to a turn that the reader does not need, or a portion of them."""
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

    def _pass(self, turn: int) -> None:
        if self._forget(turn):
            self.late += 1

    def _forget(self, turn: int) -> bool:
        """Count a message as lost no longer; whether it was."""
        if turn not in self._missed:
            return False
        del self._missed[turn]
        self.lost -= 1
        return True

    def reject(self, reason: str) -> None:
        """Count a message that was taken and then found invalid: a silent sender has not spoken with it."""
        self._rejections.add(self.mailbox.key, reason)
        self._silent |= self._broke_silence
        self._unheard |= self._broke_silence

    def spoil(self, turn: int, deadline: float | None) -> None:
        """Receive the message of a turn with flipped bytes, so that it must be rejected."""
        if self.take(turn, deadline) is not None:
            self._read(bytes(byte ^ 0xFF for byte in self._raw[:_FLIPPED]) + self._raw[_FLIPPED:], turn)
        self._forget(turn)  # it counts as lost by the fault

    def repeat(self, turn: int) -> None:
        """Receive the message of a turn, which was just taken, once more."""
        self._read(self._raw, turn)

    def hold(self, turn: int, deadline: float) -> bool:
        """Wait for the message of a turn and keep it to be taken; False where it is not there at the deadline."""
        content = self.take(turn, deadline)
        self._forget(turn)
        if content is None:
            return False
        self._held = turn, content
        return True

    def _read(self, data: bytes, turn: int) -> None:
        try:
            step, round_, sent, content = self._decode(data)
            if not self._first <= round_ < self._turns:
                raise BadMessage(f"round {round_} of a step of {self._turns - 1}")
            found = step * self._turns + round_
            if found > turn + self._horizon:
                raise BadMessage("ahead of what its sender can have reached")
        except BadMessage as error:
            self._rejections.add(self.mailbox.key, str(error))
        else:
            self._held, self._raw = (found, content), data
            self._broke_silence = self._silent
            if self._unheard:
                self._silent = self._unheard = False
                self._life = self._node.presence.life(self.owner)
            self.delay_ns += self._clock() - sent
            self.read += 1
