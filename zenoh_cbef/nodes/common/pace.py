"""Whether a process keeps up with real time.

A process that begins a round after the round's deadline is too slow itself. Every wait ends at its deadline at the
latest, and a whole slot is left until the next one, so no other process and no link can make it late.
"""

from __future__ import annotations

from math import inf
from typing import Protocol

from zenoh_cbef.protocol.slow import AGAIN_SECONDS, REMEDY, WINDOW_SECONDS, too_slow


class Teller(Protocol):
    """Says that a process is too slow: a sentence, and how many were late of those due since the start."""

    def __call__(self, text: str, /, *, late: int, due: int) -> None:
        """Say it."""


class Pace:
    """Counts the rounds (or steps) that a process begins too late, and reports when these are more than a few.

    who: the process, as in "agent 3". what: that which it comes to, in the plural. Times are monotonic, s; the caller
    tells them. late, due: counts since the start.
    """

    def __init__(self, who: str, what: str, tell: Teller) -> None:
        self._who, self._what, self._tell = who, what, tell
        self.late = self.due = 0
        self._before = 0, 0
        self._until: float | None = None
        self._slow, self._said = False, -inf

    def arrive(self, now: float, deadline: float) -> None:
        """The process comes now to something that has a deadline."""
        if self._until is None:
            self._until = now + WINDOW_SECONDS
        self.due += 1
        self.late += now > deadline
        if now >= self._until:
            self._until = now + WINDOW_SECONDS
            late, due = self.late - self._before[0], self.due - self._before[1]
            self._before = self.late, self.due
            begins, self._slow = not self._slow, too_slow(late, due)
            if self._slow and (begins or now - self._said >= AGAIN_SECONDS):
                self._said = now
                self._say(f"{late} of its last {due}")

    def finish(self) -> dict[str, int]:
        """The counts for the process's last words. A run that was too short to be judged before is judged here."""
        if self._said == -inf and too_slow(self.late, self.due):
            self._say(f"{self.late} of its {self.due}")
        return {"late": self.late, "due": self.due}

    def _say(self, many: str) -> None:
        text = f"{self._who} does not keep up with real time: it came too late to {many} {self._what}; {REMEDY}"
        self._tell(text, late=self.late, due=self.due)
