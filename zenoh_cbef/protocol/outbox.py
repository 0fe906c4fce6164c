"""Messages of one key, published with the sender's envelope."""

from __future__ import annotations

from collections.abc import Callable

import msgpack
import zenoh

from zenoh_cbef.arrays import Floats
from zenoh_cbef.protocol.memory import Memory
from zenoh_cbef.protocol.messages import VERSION
from zenoh_cbef.protocol.short import Codec


class Outbox:
    """A publisher that numbers its messages.

    may_drop: a message that a receiver cannot take in time is dropped for that receiver, so the sender never waits.
    Otherwise the sender waits, as in lockstep, where a receiver would wait for ever for a dropped message; a receiver
    that hangs loses its link after some seconds. clock: returns the sending time, ns since the Unix epoch. memory:
    keeps messages for receivers that missed them.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        *,
        run: str,
        sender: str,
        may_drop: bool,
        clock: Callable[[], int],
        memory: Memory,
    ) -> None:
        self.key, self._memory = key, memory
        self._clock = clock
        self.sent = 0
        self.leave: Callable[[int, int, bytes], bool] | None = None
        """Leaves a message, with its number and sending time, for recorders on this host, before it is sent."""
        self.overflow: Callable[[int, int, bytes], None] = lambda *_: None
        """Gets a message for which there was no room."""
        self._envelope = {"v": VERSION, "run": run, "from": sender}
        self._pack = msgpack.Packer().pack
        self._publisher = session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.DROP if may_drop else zenoh.CongestionControl.BLOCK,
            allowed_destination=zenoh.Locality.REMOTE,
        )

    def send(self, **body: object) -> bytes:
        """Publish one message, bin fields last; returns it as it was sent."""
        seq, now = self.sent, self._clock()
        data: bytes = self._pack({**self._envelope, "seq": seq, "sent": now, **body})
        step = body.get("k")
        self._put(seq, now, step if isinstance(step, int) else None, data)
        return data

    def send_round(self, codec: Codec, step: int, round_: int, payload: Floats) -> None:
        """Publish one consensus message; payload: d numbers."""
        seq, now = self.sent, self._clock()
        self._put(seq, now, step, codec.encode(seq, now, step, round_, payload))

    def _put(self, seq: int, now: int, step: int | None, data: bytes) -> None:
        self._memory.keep(seq, step, data)
        if self.leave is not None and not self.leave(seq, now, data):
            self.overflow(seq, now, data)
        self._publisher.put(data)
        self.sent = seq + 1
