"""A run in lockstep that stands still by order, and goes on by single steps."""

from __future__ import annotations

import threading
from collections.abc import Callable

_LOOK_SECONDS = 0.02


class Hold:
    """Whether the run stands still: the target begins no further step, so its agents wait for their beacons."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self.on, self._allowed = False, 0

    def order(self, *, on: bool, steps: int) -> None:
        """Let the run stand still after so many more steps, or go on. From another thread than the target's own."""
        with self._changed:
            self.on, self._allowed = on, steps
            self._changed.notify_all()

    def wait(self, meanwhile: Callable[[], None], stopping: Callable[[], bool]) -> None:
        """Wait until the next step may begin. meanwhile: called again and again."""
        with self._changed:
            while self.on and not self._allowed and not stopping():
                meanwhile()
                self._changed.wait(_LOOK_SECONDS)
            self._allowed = max(self._allowed - 1, 0)
