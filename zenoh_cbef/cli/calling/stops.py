"""Ctrl-C and other requests to end, counted by a verb that has processes to end first."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Self


class StopRequests:
    """Counts Ctrl-C and other signals that ask for an end, while it is entered; they do not end this process."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self) -> int:
        """How often an end was asked for."""
        return self.count

    def __enter__(self) -> Self:
        self._before = {one: signal.signal(one, self._note) for one in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
        return self

    def __exit__(self, *_: object) -> None:
        for one, handler in self._before.items():
            signal.signal(one, handler)

    def _note(self, _signum: int, _frame: FrameType | None) -> None:
        self.count += 1
