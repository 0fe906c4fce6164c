"""An agent's neighbours: one inbox each, in ascending order, with the fates of their messages."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.faults import Fates, Injected
from zenoh_cbef.nodes.common.alarm import Alarm
from zenoh_cbef.nodes.common.inbox import Content, Decoder, Inbox
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.readers import WINDOW, range_reader
from zenoh_cbef.nodes.common.rejections import Rejections
from zenoh_cbef.protocol.kinds import RangeMessage
from zenoh_cbef.protocol.mailbox import CAPACITY, Mailbox
from zenoh_cbef.protocol.messages import nil_to_nan
from zenoh_cbef.protocol.short import codec_of
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.moderation import LARGEST_SENT, SURELY_SENT

_OUTWAIT_SECONDS = 5.0


class Neighbourhood:
    """All neighbours of one agent.

    ids: the neighbours, ascending. fates: of the messages from them, in the same order. patience, grace: see Inbox.
    """

    def __init__(
        self,
        node: Node,
        plan: Plan,
        ids: Sequence[int],
        fates: Fates,
        *,
        rejections: Rejections,
        alarm: Alarm,
        grace: float,
    ) -> None:
        rounds, lag, width = plan.rounds, plan.scenario.consensus.lag, plan.message_size
        self._node, self.ids = node, list(ids)
        self.fates, self._rounds, self._lag = fates, rounds, lag
        self._received = np.zeros((1, len(self.ids), width))
        self._flat = self._received.ravel()
        self._no_ranges = np.zeros((1, 0, 3)), np.zeros((1, 0))
        self._rows = [memoryview(row).cast("B") for row in self._received[0]]
        self._counts = {name: [0] * len(self.ids) for name in ("received", "lost", "late")}
        self._injected, self._twice = Injected(len(self.ids)), list[int]()
        self._order, self._all_due = list(range(len(self.ids))), [True] * len(self.ids)

        def inbox(agent: int, key: str, read: Decoder[Content], turns_per_step: int) -> Inbox[Content]:
            ahead = (WINDOW + 1 + lag) * turns_per_step
            mailbox = Mailbox(node.session, key, CAPACITY + 2 * ahead)
            return Inbox(
                node,
                mailbox,
                read,
                owner=f"agent/{agent}",
                horizon=ahead,
                turns=turns_per_step,
                rejections=rejections,
                alarm=alarm,
                patience=plan.scenario.timing.patience,
                grace=grace,
            )

        run, keys = node.identity.run, node.keys
        self._round_boxes = [
            inbox(agent, keys.round(agent), codec_of(run, f"agent/{agent}", width, plan.compact).decode, rounds + 1)
            for agent in (self.ids if rounds else [])
        ]
        self._range_boxes = [
            inbox(agent, keys.range(agent), range_reader(run, agent), 1)
            for agent in (self.ids if plan.sharing.uses_neighbour_ranges else [])
        ]
        self._boxes: list[list[Inbox[bytes] | Inbox[RangeMessage]]] = [[*self._round_boxes], [*self._range_boxes]]

    def drain(self, step: int = 0) -> None:
        """Drop what has come up to a step, 0: what came before the first one."""
        for round_box in self._round_boxes:
            round_box.pass_over(step * (self._rounds + 1) + self._rounds)
        for range_box in self._range_boxes:
            range_box.pass_over(step)

    def look_around(self) -> None:
        """From now on wait for the neighbours that are there."""
        for boxes in self._boxes:
            for box in boxes:
                box.expect(there=box.owner in self._node.presence)

    def expect(self, agents: Bools) -> None:
        """From now on wait for those of all agents (n,) that come back in this step."""
        for boxes in self._boxes:
            for agent, box in zip(self.ids, boxes, strict=False):
                if agents[agent]:
                    box.expect(there=True)

    def outwait(self, step: int, absent: Bools) -> None:
        """Wait until all neighbours that are there in a step have begun it.

        All messages that they needed before it have then reached them. absent: (n,), which agents are not there.
        """
        until = time.monotonic() + _OUTWAIT_SECONDS
        for boxes, turn in zip(self._boxes, (step * (self._rounds + 1) + 1, step), strict=True):
            for agent, box in zip(self.ids, boxes, strict=False):
                if not absent[agent]:
                    box.hold(turn, until)

    def ranges(self, step: int, deadline: float | None) -> tuple[Floats, Floats]:
        """The neighbours' positions (1, m, 3) and ranges (1, m) of a step, NaN where none was delivered.

        m is 0 where the filter does not want them.
        """
        if not self._range_boxes:
            return self._no_ranges
        count = len(self._range_boxes)
        positions, ranges = np.zeros((1, count, 3)), np.full((1, count), np.nan)
        due = self._all_due if self.fates.quiet else self._due(self._range_boxes, step, (step, 0), deadline)
        for place, box in enumerate(self._range_boxes):
            if not due[place]:
                box.pass_over(step)
                continue
            message = box.take(step, deadline)
            if message is not None:
                self._counts["received"][place] += 1
                positions[0, place] = message["position"]
                ranges[0, place] = nil_to_nan(message["range"])
                if place in self._twice:
                    box.repeat(step)
        return positions, ranges

    def round(self, step: int, round_: int, deadline: float | None) -> tuple[Floats, Bools | None]:
        """The neighbours' payloads for a round, (1, m, d), and which were delivered, (1, m), None for all."""
        step -= self._lag
        if step < 1:
            return self._received, np.zeros((1, len(self.ids)), dtype=bool)
        turn, boxes, rows = step * (self._rounds + 1) + round_, self._round_boxes, self._rows
        due = self._all_due if self.fates.quiet else self._due(boxes, turn, (step, round_), deadline)
        delivered, received = [False] * len(boxes), self._counts["received"]
        slowest = self._order[0]
        for place in self._order:
            box = boxes[place]
            if not due[place]:
                box.pass_over(turn)
                continue
            payload = box.take(turn, deadline)
            if box.waited:
                slowest, box.waited = place, False
            if payload is not None:
                received[place] += 1
                delivered[place] = True
                rows[place][:] = payload
        for place in self._twice:
            if delivered[place]:
                boxes[place].repeat(turn)
        # Next time the agent waits first for the neighbour that came last this time: the others are there by then,
        # and each wait that is not needed saves two context switches.
        if slowest != self._order[0]:
            self._order.remove(slowest)
            self._order.insert(0, slowest)
        if not self._flat.dot(self._flat) < SURELY_SENT:
            self._refuse_immoderate(turn, delivered, deadline)
        return self._received, None if all(delivered) else np.array([delivered])

    def _refuse_immoderate(self, turn: int, delivered: list[bool], deadline: float | None) -> None:
        """Drop payloads that no agent sends, if there are any, and wait for their senders again.

        A forged message must not take the place of a true one.
        """
        values = self._received[0]
        for place, box in enumerate(self._round_boxes):
            # Of silence the reader makes NaN, and of no other message.
            while not (np.isnan(values[place, 0]) or (np.abs(values[place]) <= LARGEST_SENT).all()):
                values[place] = 0.0
                if delivered[place]:
                    box.reject("a payload that is not finite, or larger than any can be")
                    payload = box.take(turn, deadline)
                    delivered[place] = payload is not None
                    if payload is not None:
                        self._rows[place][:] = payload
                    else:
                        self._counts["received"][place] -= 1

    def _due(
        self, boxes: Sequence[Inbox[Content]], turn: int, when: tuple[int, int], deadline: float | None
    ) -> Sequence[bool]:
        """Which messages of a step and round the faults let arrive intact in time; the others are not waited for."""
        fate = self.fates.of(*when)
        self._injected.note(fate)
        due: list[bool] = fate.due.tolist()
        for place in np.flatnonzero(~(fate.due | fate.absent)).tolist():
            self._counts["late" if fate.late[place] else "lost"][place] += 1
        if deadline is not None:
            self._delay(boxes, turn, np.where(fate.due, fate.delay, 0.0), due, deadline)
        for place in np.flatnonzero(fate.corrupted).tolist():
            boxes[place].spoil(turn, deadline)
        self._twice = np.flatnonzero(fate.duplicated).tolist()
        return due

    def _delay(
        self, boxes: Sequence[Inbox[Content]], turn: int, delay: Floats, due: list[bool], deadline: float
    ) -> None:
        """Hold messages back for their delays (m,), s, and strike from `due` those that are late by them.

        A message must have come by the deadline less its delay. The agent waits first for the message with the
        earliest limit, so no limit passes unseen; the others arrive meanwhile.
        """
        ready, late = time.monotonic(), []
        for place in sorted(np.flatnonzero(delay).tolist(), key=lambda one: -delay[one]):
            came = boxes[place].hold(turn, deadline - delay[place])
            usable = time.monotonic() + delay[place]
            if came and usable <= deadline:
                ready = max(ready, usable)
                boxes[place].delay_ns += int(1e9 * delay[place])
            else:
                late.append(place)
        time.sleep(max(0.0, (deadline if late else ready) - time.monotonic()))
        for place in late:
            due[place] = False
            if boxes[place].hold(turn, deadline):
                self._counts["late"][place] += 1
                self._injected.add("injected_late", place)
            else:
                boxes[place].miss(turn)

    def take_counts(self) -> dict[str, object]:
        """The fates of the neighbours' messages: counts since the start, and mean latency (s) since the last call.

        A message that comes after the agent gave it up, and counted it as lost, counts as late instead. A neighbour
        that is not there sends nothing that could be lost.
        """
        received, lost, late = [*self._counts["received"]], [*self._counts["lost"]], [*self._counts["late"]]
        delay, read = [0] * len(self.ids), [0] * len(self.ids)
        for boxes in self._boxes:
            for place, box in enumerate(boxes):
                delay[place] += box.delay_ns
                read[place] += box.read
                late[place] += box.late
                lost[place] += box.lost
                box.delay_ns = box.read = 0
        latency = [1e-9 * total / n if n else None for total, n in zip(delay, read, strict=True)]
        counts: dict[str, object] = {
            "neighbours": self.ids,
            "received": received,
            "lost": lost,
            "late": late,
            "latency": latency,
        }
        return counts if self.fates.quiet else counts | self._injected.take().fields()
