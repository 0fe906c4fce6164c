"""What the target tells agents besides beacons, each agent on a key of its own."""

from __future__ import annotations

from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.protocol.fields import END, ROUND, START


class Signalling:
    """The signals to all agents of a run. boxes: their outboxes."""

    def __init__(self, node: Node, count: int) -> None:
        self.boxes = [node.outbox(node.keys.signal(agent)) for agent in range(count)]

    def start(self, agent: int, step: int, at: float) -> None:
        """Tell an agent that its first step is the one after this. at: when step 0 is or was, s since 1970."""
        self.boxes[agent].send(k=step, signal=START, at=at)

    def round(self, step: int, number: int) -> None:
        """Let all agents make the rounds of a step up to this one."""
        for box in self.boxes:
            box.send(k=step, signal=ROUND, l=number)

    def end(self, step: int) -> None:
        """Tell all agents that this step will not come."""
        for box in self.boxes:
            box.send(k=step, signal=END)
