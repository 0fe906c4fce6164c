"""Whether the agents that take part can determine the position at all."""

from __future__ import annotations

from collections.abc import Sequence

from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.sight import described, open_axes_between, window_of
from zenoh_cbef.tracking.sight import MIRRORED


class Lookout:
    """Tells the log when the agents that take part cannot determine the position any more, and when they can again.

    problem: a sentence on what their ranges fit; empty where they determine the position, except for a mirror image.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._agents: list[int] | None = None
        self._due = 0
        self.problem = ""

    def look(self, plan: Plan, agents: Sequence[int], step: int) -> None:
        """Look at the agents in a step; while they stay the same, once in a window of steps, as they may move."""
        length = plan.scenario.length
        span = window_of(plan, length)
        if list(agents) == self._agents and step < self._due:
            return
        self._agents, self._due = list(agents), step + span
        first = max(1, min(step - span // 2, length - span + 1))
        left_open = open_axes_between(plan, agents, first, first + span - 1)
        former, self.problem = self.problem, ""
        if left_open > MIRRORED:
            self.problem = described(plan, len(agents), left_open)
        if self.problem and not former:
            text = f"from step {step} on the position cannot be determined: {self.problem}"
            self._node.event("unobservable", text, step=step, agents=self._agents)
        elif former and not self.problem:
            self._node.event("observable", f"from step {step} on the position can be determined again", step=step)
