"""Messages that were dropped because they are not what their key promises."""

from __future__ import annotations

import time
from collections import Counter

from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.words import counted

_REPORT_EVERY = 1.0
_REASONS = 1000
"""Different reasons that are counted apart: senders can make up any number of them."""


class Rejections:
    """Counts rejected messages and reports them on the event key, at most once a second.

    Until `start` nothing is published: a recorder may not be there yet to hear of it.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._counts: Counter[str] = Counter()
        self._reported_at = -_REPORT_EVERY
        self._unreported = False
        self._started = False

    def start(self) -> None:
        """From now on, report."""
        self._started = True

    @property
    def total(self) -> int:
        """How many messages were rejected so far."""
        return sum(self._counts.values())

    def add(self, key: str, reason: str) -> None:
        """Note one."""
        named = f"{key:.200}: {reason:.200}"
        self._counts[named if named in self._counts or len(self._counts) < _REASONS else "other reasons"] += 1
        self._unreported = True
        if self._started and time.monotonic() - self._reported_at >= _REPORT_EVERY:
            self.report()

    def report(self) -> None:
        """Publish what was not published yet."""
        if not self._unreported:
            return
        self._unreported = False
        self._reported_at = time.monotonic()
        worst, count = self._counts.most_common(1)[0]
        text = f"{counted(self.total, 'message')} rejected, {count} of them {worst}"
        self._node.event("rejected", text, total=self.total, reasons=dict(self._counts.most_common(10)))
