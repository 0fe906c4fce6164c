"""How an agent reads its beacons and its neighbours' ranges."""

from __future__ import annotations

from math import inf

from zenoh_cbef.nodes.common.alarm import Alarm
from zenoh_cbef.nodes.common.inbox import Decoder, Inbox
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.rejections import Rejections
from zenoh_cbef.protocol.kinds import BEACON, RANGE, BeaconMessage, RangeMessage
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.messages import BadMessage, decode

WINDOW = 4
"""How many steps the target, and so any agent, can be ahead of the slowest agent in lockstep."""


def beacon_inbox(node: Node, agent: int, rejections: Rejections, alarm: Alarm, grace: float) -> Inbox[BeaconMessage]:
    """The beacons of an agent's own receiver; the turn is the step."""

    def read(data: bytes) -> tuple[int, int, int, BeaconMessage]:
        message = decode(BEACON, data, run=node.identity.run)
        if "signal" in message:
            raise BadMessage("a signal, which has a key of its own")
        return message["k"], 0, message["sent"], message

    mailbox = Mailbox(node.session, node.keys.beacon(agent))
    # The target waits for an agent that is stuck, and its own patience ends the run.
    return Inbox(
        node,
        mailbox,
        read,
        owner="target/target",
        horizon=2 * WINDOW,
        turns=1,
        rejections=rejections,
        alarm=alarm,
        patience=inf,
        grace=grace,
    )


def range_reader(run: str, agent: int) -> Decoder[RangeMessage]:
    """Positions and ranges of a neighbour; the turn is the step."""

    def read(data: bytes) -> tuple[int, int, int, RangeMessage]:
        message = decode(RANGE, data, run=run, sender=f"agent/{agent}")
        return message["k"], 0, message["sent"], message

    return read
