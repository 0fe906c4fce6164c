"""An agent's neighbours: one inbox each, in ascending order, with what the faults say of every message."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.faults import Fates
from zenoh_cbef.nodes.inbox import Alarm, Decoder, Inbox
from zenoh_cbef.nodes.node import Node
from zenoh_cbef.nodes.rejections import Rejections
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.messages import BadMessage, decode, nil_to_nan, unpack_floats

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

WINDOW = 4
"""How many steps the target, and so any agent, can be ahead of the slowest agent in lockstep."""


@dataclass(frozen=True)
class Ranges:
    """Neighbours' positions (1, m, 3) and ranges (1, m) of a step, NaN where none was delivered."""

    positions: Floats
    ranges: Floats


def beacon_inbox(node: Node, agent: int, rejections: Rejections, alarm: Alarm | None) -> Inbox:
    """The beacons of an agent's own receiver; the turn is the step, 0 is the start signal."""

    def read(data: bytes) -> tuple[int, dict[str, Any]]:
        message = decode("beacon", data, run=node.identity.run)
        return message["k"], message

    mailbox = Mailbox(node.session, node.keys.beacon(agent), 4 * WINDOW)
    return _inbox(node, mailbox, read, "target/target", 2 * WINDOW, rejections, alarm)


def _inbox(
    node: Node,
    mailbox: Mailbox,
    read: Decoder,
    owner: str,
    horizon: int,
    rejections: Rejections,
    alarm: Alarm | None,
) -> Inbox:
    def on_change(name: str, joined: bool) -> None:
        if name == owner and not joined:
            mailbox.wake()

    node.presence.on_change(on_change)
    node.on_stop(mailbox.wake)
    return Inbox(
        mailbox,
        read,
        horizon=horizon,
        alive=lambda: owner in node.presence and not node.stopping,
        on_reject=rejections.add,
        alarm=alarm,
    )


class Neighbourhood:
    """All neighbours of one agent.

    ids: the neighbours, ascending. fates: of the messages from them, in the same order. rounds: L. width: d, the
    payload's length. shares_ranges: whether neighbours' ranges are wanted.
    """

    def __init__(
        self,
        node: Node,
        ids: Sequence[int],
        fates: Fates,
        *,
        rounds: int,
        width: int,
        shares_ranges: bool,
        rejections: Rejections,
        alarm: Alarm | None,
    ) -> None:
        self.ids = list(ids)
        self._fates, self._rounds, self._width = fates, rounds, width
        self._received = np.zeros((1, len(self.ids), width))
        self._counts = {name: np.zeros(len(self.ids), dtype=np.int64) for name in ("received", "lost", "late")}
        self._taken = np.zeros(len(self.ids), dtype=np.int64)
        self._everyone = np.ones(len(self.ids), dtype=bool)
        turns = rounds + 1

        def inbox(agent: int, key: str, read: Callable[[int], Decoder], steps_to_turns: int) -> Inbox:
            ahead = (WINDOW + 1) * steps_to_turns
            mailbox = Mailbox(node.session, key, 2 * ahead)
            return _inbox(node, mailbox, read(agent), f"agent/{agent}", ahead, rejections, alarm)

        run = node.identity.run
        self._round_boxes = [
            inbox(agent, node.keys.round(agent), lambda owner: self._read_round(run, owner), turns)
            for agent in (self.ids if rounds else [])
        ]
        self._range_boxes = [
            inbox(agent, node.keys.range(agent), lambda owner: _read_range(run, owner), 1)
            for agent in (self.ids if shares_ranges else [])
        ]

    def ranges(self, step: int, deadline: float | None) -> Ranges:
        """The neighbours' positions and ranges of a step; none where the filter does not want them."""
        count = len(self._range_boxes)
        positions, ranges = np.zeros((1, count, 3)), np.full((1, count), np.nan)
        if count:
            for place, message in self._collect(self._range_boxes, step, 0, step, deadline):
                positions[0, place] = message["position"]
                ranges[0, place] = nil_to_nan(message["range"])
        return Ranges(positions, ranges)

    def round(self, step: int, round_: int, deadline: float | None) -> tuple[Floats, Bools]:
        """The neighbours' payloads of a round, (1, m, d), and which were delivered, (1, m)."""
        delivered = np.zeros((1, len(self.ids)), dtype=bool)
        turn = step * (self._rounds + 1) + round_
        for place, message in self._collect(self._round_boxes, step, round_, turn, deadline):
            self._received[0, place] = message["values"]
            delivered[0, place] = True
        return self._received, delivered

    def _collect(
        self, boxes: list[Inbox], step: int, round_: int, turn: int, deadline: float | None
    ) -> list[tuple[int, dict[str, Any]]]:
        due = self._everyone
        if not self._fates.quiet:
            due, late = self._fates.due(step, round_)
            self._counts["late"] += late
            self._counts["lost"] += ~due & ~late
        found = []
        for place, box in enumerate(boxes):
            if not due[place]:
                continue
            message = box.take(turn, deadline)
            if message is None:
                self._counts["lost"][place] += 1
            else:
                self._counts["received"][place] += 1
                found.append((place, message))
        return found

    def take_counts(self) -> dict[str, list[Any]]:
        """What became of the neighbours' messages: counts since the start, and mean latency since the last call.

        A message that came after it was given up was counted as lost then, and is late instead.
        """
        delay = np.zeros(len(self.ids))
        late = np.zeros(len(self.ids), dtype=np.int64)
        for boxes in (self._round_boxes, self._range_boxes):
            for place, box in enumerate(boxes):
                delay[place] += 1e-9 * box.delay_ns
                late[place] += box.late
                box.delay_ns = 0
        taken = self._counts["received"] - self._taken
        self._taken = self._counts["received"].copy()
        return {
            "neighbours": self.ids,
            "received": self._counts["received"].tolist(),
            "lost": (self._counts["lost"] - late).tolist(),
            "late": (self._counts["late"] + late).tolist(),
            "latency": [float(sum_ / n) if n else None for sum_, n in zip(delay, taken, strict=True)],
        }

    def _read_round(self, run: str, agent: int) -> Decoder:
        sender, turns, width = f"agent/{agent}", self._rounds + 1, self._width

        def read(data: bytes) -> tuple[int, dict[str, Any]]:
            message = decode("round", data, run=run, sender=sender)
            if not 1 <= message["l"] < turns:
                raise BadMessage(f"round {message['l']} of a step of {turns - 1}")
            message["values"] = unpack_floats(message["payload"], width)
            return message["k"] * turns + message["l"], message

        return read


def _read_range(run: str, agent: int) -> Decoder:
    sender = f"agent/{agent}"

    def read(data: bytes) -> tuple[int, dict[str, Any]]:
        message = decode("range", data, run=run, sender=sender)
        return message["k"], message

    return read
