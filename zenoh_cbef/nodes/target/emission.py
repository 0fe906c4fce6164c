"""What the target publishes of itself in every step: the truth, and a beacon for each agent; with rings also there."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.courses import RECORDED
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.own_ring import OwnRing
from zenoh_cbef.protocol.messages import nan_to_nil
from zenoh_cbef.protocol.outbox import Outbox
from zenoh_cbef.protocol.ring_folder import OF_TARGET
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import World


class Emission:
    """The keys of truth and beacons. boxes: their outboxes.

    receivers: real ones publish the beacons. The truth of a real target is unknown; a recording that is played to
    receivers keeps its own.
    """

    def __init__(self, node: Node, plan: Plan, *, receivers: bool) -> None:
        agents, may_drop = range(plan.scenario.count), plan.realtime
        self._truth = node.outbox(node.keys.truth, may_drop=may_drop)
        self._beacons = [node.outbox(node.keys.beacon(agent), may_drop=may_drop) for agent in agents]
        self._tells_beacons = not receivers
        self._tells_truth = not receivers or plan.scenario.target.motion == RECORDED
        self._ring = None
        if plan.scenario.record.rings and self._tells_beacons:
            self._ring = OwnRing(node, OF_TARGET, self.boxes, plan.scenario.record, may_wait=not may_drop)
            node.on_close(self._ring.end)

    def begin(self) -> None:
        """Say what is wrong with the ring, now that recorders hear the target."""
        if self._ring is not None:
            self._ring.begin()

    @property
    def boxes(self) -> list[Outbox]:
        """The outboxes."""
        return [self._truth, *self._beacons]

    def emit(self, world: World, step: int, lists: int, *, by_rounds: bool = False) -> None:
        """Publish a step. lists: how many lists of injected faults were published before it. by_rounds: see Hold."""
        truth = world.truth[step - 1]
        if self._tells_truth and np.isfinite(truth).all():  # the truth of a real target is unknown
            self._truth.send(k=step, state=truth.tolist())
        told = ({"lists": lists} if lists else {}) | ({"by_rounds": True} if by_rounds else {})
        times = world.emitted[:, step - 1].tolist(), world.arrived[:, step - 1].tolist()
        for beacon, emitted, arrived in zip(self._beacons, *times, strict=True) if self._tells_beacons else ():
            beacon.send(k=step, emitted=nan_to_nil(emitted), arrived=nan_to_nil(arrived), **told)
