"""Which processes of a run are there, as its recorder sees it."""

from __future__ import annotations

import time
from collections.abc import Callable

from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.succession import TARGET, Succession
from zenoh_cbef.protocol.keys import agent_named
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.tokens import in_words, is_expected, leads

_GRACE_SECONDS = 2.0
_LOST_SECONDS = 30.0
_NAMED_SECONDS = 30.0


def takes_part(sender: str, presence: Presence) -> bool:
    """Whether a process, by its name in messages, is one of the run's: the target, or an agent that is there."""
    return sender == "target" or (agent_named(sender) is not None and sender in presence)


def led_by_a_target(node: Node) -> bool:
    """Whether a target leads what is recorded, and not a replay, which gives no names and has no agents to link to.

    Waits for the name of the one or the other: each serves the scenario a moment before it announces itself.
    """
    node.wait_for(lambda live: any(map(leads, live)), _NAMED_SECONDS)
    return TARGET in node.presence


class Attendance:
    """Reports processes that left without a farewell or came back, and knows when all have left for good.

    tell: puts an event of this kind, text and data into the log; called from a background thread. patience: how long
    (s) agents of the run wait for each other.
    """

    def __init__(self, node: Node, tell: Callable[[str, str, str], None], patience: float) -> None:
        self._node, self._tell, self._patience = node, tell, _LOST_SECONDS + 2.0 * patience
        self._alive_at, self._step = time.monotonic(), 0
        self._departed: set[str] = set()
        self._lost: set[str] = set()
        self._succession = Succession(node.presence)
        self._seen = False
        self._gone_at: float | None = None
        node.presence.on_change(self._note_change)

    def farewell(self, sender: str) -> None:
        """A process says that it is done."""
        name = TARGET if sender == "target" else sender
        if is_expected(name):
            self._departed.add(name)

    def _note_change(self, name: str, joined: bool) -> None:
        if joined:
            self._departed.discard(name)
        if self._succession.replaced:
            return  # no more words into the other run
        if not is_expected(name) or self._node.stopping:
            return
        if name in self._departed or self._node.presence.is_over(name):
            return
        who = f"the {in_words(name)}" if leads(name) else in_words(name)
        if joined and name in self._lost:
            self._lost.discard(name)
            self._tell("returned", f"{who} is there again", name)
        elif not joined:
            self._lost.add(name)
            self._tell("left", f"{who} is gone without a farewell", name)

    def over(self, *, lacking: bool, step: int) -> bool:
        """Whether no process of the run is there any more, or another target has begun another run of its name.

        lacking: what they said they sent has not all come.

        A process that vanished without a farewell may be behind a broken link, or this recorder may be. So the recorder
        waits longer for it, and for a target that gave it the scenario and was not seen since. step: the latest of
        which an estimate came. Without the target, the recorder does not wait for agents that make no progress, so that
        nothing that they do keeps it for ever.
        """
        if self._succession.replaced:
            return True
        names, now = self._node.presence.names(), time.monotonic()
        if step > self._step or any(map(leads, names)):
            self._alive_at, self._step = now, step
        hung = now - self._alive_at > self._patience
        if not hung and any(map(is_expected, names)):
            self._seen, self._gone_at = True, None
            return False
        self._gone_at = self._gone_at or now
        lost = self._lost and TARGET not in self._departed and not self._node.launched
        if lost or not self._seen:
            return time.monotonic() - self._gone_at > _LOST_SECONDS
        return not lacking or time.monotonic() - self._gone_at > _GRACE_SECONDS
