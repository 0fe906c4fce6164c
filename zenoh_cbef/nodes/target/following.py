"""Whether the recorders keep up: in lockstep the run waits for one that falls behind, so that its log is complete."""

from __future__ import annotations

import time
from collections.abc import Callable

from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.readers import WINDOW
from zenoh_cbef.nodes.target.progress import Progress
from zenoh_cbef.protocol.reached import ask_reached
from zenoh_cbef.protocol.tokens import in_words, is_recorder

_WAITING = 40_000
"""Messages of a run that can wait in a recorder's mailbox and its links: a third of what the mailbox holds."""
_MOST_STEPS = 50
_ASK_SECONDS, _AGAIN_SECONDS = 1.0, 0.1
_STILL_SECONDS, _STOPPING_SECONDS = 10.0, 3.0
"""For how long a recorder may make no progress; and how long the target waits for it when the run is to stop."""


class Following:
    """Asks recorders how far they have got, and waits for them.

    messages: of all agents in a step. A recorder may be as many steps behind as its mailbox holds, and at least as many
    as agents can be apart. The target stops waiting for a recorder that makes no progress.
    """

    def __init__(self, node: Node, progress: Progress, messages: int) -> None:
        self._node, self._progress = node, progress
        self._ahead = max(WINDOW, min(_MOST_STEPS, _WAITING // messages))
        self._until = self._ahead
        self._known: dict[str, dict[int, int]] = {}
        self._left: dict[str, dict[int, int]] = {}

    def wait(self, step: int, meanwhile: Callable[[], None]) -> None:
        """Wait until a step may begin: all recorders have come near enough to it."""
        if step <= self._until:
            return
        needed = step - self._ahead
        kept_up = self._wait_for(needed, meanwhile, lambda _: self._node.stopping)
        self._until = (self._slowest(step - 1) if kept_up else step) + self._ahead

    def finish(self, last: int) -> None:
        """Wait until all recorders have taken in the last step; for a short while only where the run is to stop."""
        self._wait_for(last, lambda: None, lambda waited: self._node.stopping and waited > _STOPPING_SECONDS)

    def _wait_for(self, step: int, meanwhile: Callable[[], None], enough: Callable[[float], bool]) -> bool:
        """Wait until all recorders have taken in a step, or make no progress: then they are left behind."""
        began = moved = time.monotonic()
        while True:
            told = ask_reached(self._node.session, self._node.keys, _ASK_SECONDS)
            now = time.monotonic()
            if any(self._known.get(name) != reached for name, reached in told.items()):
                moved = now
            self._known |= told
            behind = self._behind(step)
            if not behind or enough(now - began):
                return not behind
            if now - moved > _STILL_SECONDS:
                self._leave(behind, step)
                return False
            meanwhile()
            time.sleep(_AGAIN_SECONDS)

    def _behind(self, step: int) -> list[str]:
        return [name for name in self._recorders() if (low := self._low(name, step)) is None or low < step]

    def _slowest(self, step: int) -> int:
        return min((self._low(name, step) or 0 for name in self._recorders()), default=step)

    def _recorders(self) -> list[str]:
        return sorted(filter(is_recorder, self._node.presence.names()))

    def _low(self, name: str, step: int) -> int | None:
        """The step, at most the given one, of which a recorder has all that agents sent; None where it does not tell.

        What an agent has not sent does not count, nor does an agent whose estimates no longer reach the recorder.
        """
        known, left = self._known.get(name), self._left.get(name)
        if known is None:
            return None if left is None else step
        sent = self._progress.heard()
        due = (
            agent
            for agent, reached in known.items()
            if reached < min(step, sent.get(agent, 0)) and (left is None or left.get(agent) != reached)
        )
        return min((known[agent] for agent in due), default=step)

    def _leave(self, behind: list[str], step: int) -> None:
        for name in behind:
            if self._low(name, step) != step:
                self._left[name] = dict(self._known.get(name, {}))
        names = ", ".join(map(in_words, behind))
        self._node.event("behind", f"{names} did not get to step {step}; the run goes on without", step=step)
