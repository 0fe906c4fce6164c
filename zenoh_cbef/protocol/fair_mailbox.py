"""Messages of many keys: a flood on one of them loses messages of that key alone."""

from __future__ import annotations

from collections import Counter, deque
from functools import lru_cache

import zenoh

from zenoh_cbef.protocol.keys import address
from zenoh_cbef.protocol.mailbox import Mailbox

_SORTED, _READ = 1024, 256
"""How many messages are sorted at once, and how many are read before it is time to sort again: about the same work."""
_ROOM_BYTES = 1 << 26
_COST_BYTES = 512
"""What a waiting message takes in memory beside its own bytes."""


@lru_cache(maxsize=1024)  # as the addresses of keys
def _queue_of(key: str) -> str:
    """Where a message waits: keys that a run does not have share one queue, likewise those with chosen names."""
    at = address(key)
    if at is None:
        return ""
    return at.kind if at.chosen else key


class FairMailbox(Mailbox):
    """A mailbox of many keys, whose reader may be slower than a flood on some of them.

    The reader sorts what has come, which is fast, before it uses any of it, which is slow. The messages of a key may
    take as much room as is still free (dynamic thresholds: Choudhury and Hahne, IEEE/ACM Transactions on Networking
    6(2), 1998); further ones are dropped. So a flood on one key takes half of the room, one on two keys a third each,
    and there is always room for the messages of other keys. They come out in the order of their arrival.

    capacity: messages that can wait to be sorted. room: bytes of messages that can wait after that.
    """

    def __init__(self, session: zenoh.Session, key: str, capacity: int, room: int = _ROOM_BYTES) -> None:
        super().__init__(session, key, capacity)
        self._waiting: deque[tuple[str, bytes, str]] = deque()
        self._taken: Counter[str] = Counter()
        self._free = room
        self._until_sorted = 0

    def receive_from(self) -> tuple[str, bytes] | None:
        """The next message's key and bytes; None after a wake-up."""
        if not self._waiting:
            self._sort(self._receive())
        return self.poll_from()

    def poll_from(self) -> tuple[str, bytes] | None:
        """As receive_from, but None at once where nothing waits."""
        if not (self._waiting and self._until_sorted):
            self._sort_portion()
        if not self._waiting:
            return None
        self._until_sorted -= 1
        key, data, queue = self._waiting.popleft()
        cost = _COST_BYTES + len(data)
        self._free += cost
        self._taken[queue] -= cost
        return key, data

    def _sort_portion(self) -> None:
        self._until_sorted = _READ
        for _ in range(_SORTED):
            sample = self.sample()
            if sample is None:
                return
            self._sort(sample)

    def _sort(self, sample: zenoh.Sample) -> None:
        data = sample.payload.to_bytes() or self.empty()
        if data is None:
            return
        key = str(sample.key_expr)
        queue, cost = _queue_of(key), _COST_BYTES + len(data)
        if self._taken[queue] + cost <= self._free:
            self._waiting.append((key, data, queue))
            self._taken[queue] += cost
            self._free -= cost
