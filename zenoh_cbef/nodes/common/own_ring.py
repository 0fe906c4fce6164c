"""The ring in which an agent, or the target, leaves what it publishes, for recorders on its host."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.ring_place import ring_folder
from zenoh_cbef.protocol.outbox import Outbox
from zenoh_cbef.protocol.ring import RingWriter
from zenoh_cbef.protocol.ring_folder import OF_TARGET
from zenoh_cbef.scenario.model import Record

RING = "ring"
"""Kind of the event with which a process says that recorders hear it over Zenoh, and not by its ring."""
_PATIENCE_SECONDS, _LOOK_SECONDS = 1.0, 0.001


class OwnRing:
    """What boxes publish is first left in the ring, by the thread that sends.

    owner: an agent, or OF_TARGET. may_wait: whether it waits for a reader when the ring is full, once and for a second
    at most. A process whose ring cannot be made, or is full, says so in an event, and is heard over Zenoh from then on.
    """

    def __init__(self, node: Node, owner: int, boxes: Sequence[Outbox], settings: Record, *, may_wait: bool) -> None:
        self._node, self._boxes, self._may_wait = node, boxes, may_wait
        self._who = "the target" if owner == OF_TARGET else f"agent {owner}"
        self._about: dict[str, object] = {} if owner == OF_TARGET else {"agent": owner}
        self._ring: RingWriter | None = None
        self._trouble = ""
        try:
            folder = ring_folder(node)
            path = folder.ring(owner, str(node.session.zid()))
            self._ring = RingWriter(path, [box.key for box in boxes], settings.ring_bytes, folder.is_read)
        except OSError as error:
            self._trouble = f"{self._who} has no ring ({error.strerror or error}); recorders hear it over Zenoh"
            return
        self._folder = folder
        for kind, box in enumerate(boxes):
            box.leave = partial(self._ring.write, kind)
            box.overflow = partial(self._overflow, self._ring, kind)

    def begin(self) -> None:
        """Say what went wrong, now that recorders hear the process."""
        if self._trouble:
            self._node.event(RING, self._trouble, **self._about)

    def _overflow(self, ring: RingWriter, kind: int, number: int, sent: int, data: bytes) -> None:
        if ring.readers and self._wrote_later(partial(ring.write, kind, number, sent, data)):
            return
        for box in self._boxes:
            box.leave = None
        ring.leave()
        text = f"the ring of {self._who} is full; recorders hear it over Zenoh from now on"
        self._node.event(RING, text, **self._about)

    def _wrote_later(self, write: Callable[[], bool]) -> bool:
        until = time.monotonic() + (_PATIENCE_SECONDS if self._may_wait else 0.0)
        while time.monotonic() < until and not self._node.stopping:
            time.sleep(_LOOK_SECONDS)
            if write():
                return True
        return False

    def end(self) -> None:
        """Nothing more comes. A recorder that reads the ring removes it when it has read it all."""
        if self._ring is not None:
            self._ring.close(remove=not self._ring.readers)
            self._folder.tidy()
