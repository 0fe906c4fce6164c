"""The target's signals to an agent: the run begins, a round may be made, the run is over."""

from __future__ import annotations

import math
import queue
import threading
import time

from zenoh_cbef.nodes.common.inbox import Inbox, Stopped
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.rejections import Rejections
from zenoh_cbef.protocol.fields import END, ROUND, START
from zenoh_cbef.protocol.kinds import SIGNAL, BeaconMessage, SignalMessage
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.memory import ask_latest
from zenoh_cbef.protocol.messages import BadMessage, decode

_KEPT = 64
_WAITING = 1 << 10
_LOOK_SECONDS, _ASK_SECONDS = 0.2, 2.0
_TARGET = "target/target"


class Signals:
    """The signals to one agent, read by a thread of their own: no flood of beacons can drown or delay them.

    A signal names its step, so it does not matter whether a beacon overtakes it. beacons: the inbox to end
    when no more beacons will come. grace: how long (s) a target that is out of sight can come back.
    """

    def __init__(
        self, node: Node, agent: int, rejections: Rejections, beacons: Inbox[BeaconMessage], grace: float
    ) -> None:
        self._node, self._rejections, self._beacons = node, rejections, beacons
        self._mailbox = Mailbox(node.session, node.keys.signal(agent), _WAITING)
        self._starts: queue.SimpleQueue[SignalMessage] = queue.SimpleQueue()
        self._end: int | None = None
        self._grace, self._changed, self._released = grace, threading.Condition(), (0, 0)
        # A link that breaks may have lost the end of the run, too.
        beacons.on_recall = self._ask
        node.follow(self._mailbox, self._take)

    def start(self, seconds: float) -> SignalMessage | None:
        """The next start signal, waited for so many seconds; None where none came."""
        try:
            return self._starts.get(timeout=seconds)
        except queue.Empty:
            return None

    def over(self, step: int | None = None) -> bool:
        """Whether the run was said to be over before a step, None: before any."""
        return self._end is not None and (step is None or step >= self._end)

    def await_round(self, step: int, round_: int) -> None:
        """Wait until the target lets agents make a round of a step, or is gone. Raises Stopped."""
        gone_at, ask_at = math.inf, time.monotonic() + _ASK_SECONDS
        while not self._is_let(step, round_):
            if self._node.stopping:
                raise Stopped
            now, presence = time.monotonic(), self._node.presence
            gone_at = math.inf if _TARGET in presence else min(gone_at, now)
            if presence.is_over(_TARGET) or now >= gone_at + self._grace:
                return
            if now >= ask_at:
                # A link that broke may have lost the signal.
                self._ask()
                ask_at = now + _ASK_SECONDS

    def _is_let(self, step: int, round_: int) -> bool:
        """Whether the round may be made, or may after some waiting."""
        with self._changed:
            return self._changed.wait_for(lambda: self._released >= (step, round_), timeout=_LOOK_SECONDS)

    def _ask(self) -> None:
        for data in ask_latest(self._node.session, self._mailbox.key):
            self._take(data, starts=False)

    def _take(self, data: bytes, *, starts: bool = True) -> None:
        try:
            message = decode(SIGNAL, data, run=self._node.identity.run, sender="target")
        except BadMessage as error:
            self._rejections.add(self._mailbox.key, str(error))
            return
        if message["signal"] == END:
            self._end = message["k"]
            self._beacons.end(self._end)
        elif message["signal"] == ROUND:
            with self._changed:
                self._released = max(self._released, (message["k"], message.get("l", 0)))
                self._changed.notify_all()
        elif starts and message["signal"] == START and self._starts.qsize() < _KEPT:
            self._starts.put(message)
