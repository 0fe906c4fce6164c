"""Asks senders for the messages that a recorder missed."""

from __future__ import annotations

import threading
from collections.abc import Callable

from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.protocol.memory import ask_numbers

_LOOK_SECONDS = 0.5
_AT_ONCE = 20
_KEPT = 10_000
"""The most gaps that the recorder asks for at a time, and the most that it remembers as asked for."""


Gap = tuple[str, str, int, int]
"""Sender, key, first and last number."""


class Recovery:
    """Asks every sender that is there, once for each gap in its numbers, for what is missing.

    A message is missing after a broken link, or where the recorder did not keep up. lock: of the log; write: puts a
    message into it. believes: whether a sender that answers is the process whose messages are missing, asked with the
    lock.
    """

    def __init__(
        self,
        node: Node,
        log: RunLog,
        lock: threading.Lock,
        write: Callable[[str, bytes], None],
        believes: Callable[[str], bool] = lambda _: True,
    ) -> None:
        self._node, self._log, self._lock, self._write, self._believes = node, log, lock, write, believes
        self._asked: set[Gap] = set()

    def run(self, done: threading.Event) -> None:
        """Look for gaps now and then, until done."""
        while not done.wait(_LOOK_SECONDS):
            with self._lock:
                gaps = [gap for gap in self._open_gaps() if self._is_here(gap[0])][:_AT_ONCE]
            for gap in gaps:
                if done.is_set():
                    return
                self._ask(*gap)

    def _is_here(self, sender: str) -> bool:
        return (sender if "/" in sender else f"{sender}/{sender}") in self._node.presence

    def lacks(self, sender: str) -> bool:
        """Whether messages of a sender are missing for which we have not asked yet. The caller has the log's lock."""
        return bool(self._open_gaps(sender))

    def _open_gaps(self, of: str | None = None) -> list[Gap]:
        return [gap for gap in self._log.gaps(of) if gap not in self._asked]

    def _ask(self, sender: str, key: str, first: int, last: int) -> None:
        found = ask_numbers(self._node.session, key, first, last)
        with self._lock:
            if len(self._asked) >= _KEPT:
                self._asked.clear()
            self._asked.add((sender, key, first, last))
            if not self._believes(sender):
                return
        for data in found:
            with self._lock:
                if self._log.wants(key, sender, data):
                    self._write(key, data)
