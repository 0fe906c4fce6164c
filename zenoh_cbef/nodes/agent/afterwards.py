"""What an agent says of earlier steps: its smoothed estimates."""

from __future__ import annotations

from collections.abc import Iterable

from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.protocol.bodies import smoothed_body
from zenoh_cbef.protocol.outbox import Outbox
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.smoothing import FixedLag, Smoothed


class Afterwards:
    """Smooths an agent's own estimates, and publishes each when its lag is over."""

    def __init__(self, node: Node, agent: int, smoother: FixedLag, *, may_drop: bool, keep: int) -> None:
        self._smoother = smoother
        self.box: Outbox = node.outbox(node.keys.smoothed(agent), may_drop=may_drop, keep=keep)

    def take(self, step: int, belief: Belief, *, there: bool) -> None:
        """Take in the belief of a step, and publish what is due; an agent that is not there says nothing."""
        self._smoother.take(step, belief)
        if there:
            self._say(self._smoother.due())

    def finish(self) -> None:
        """Publish what was not due yet."""
        self._say(self._smoother.rest())

    def _say(self, smoothed: Iterable[Smoothed]) -> None:
        for one in smoothed:
            if one.known[0]:
                self.box.send(**smoothed_body(one, 0))
