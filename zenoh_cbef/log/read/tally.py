"""What was counted in a log."""

from __future__ import annotations

from dataclasses import dataclass, field

from zenoh_cbef.log.common.sequence import Sequences
from zenoh_cbef.plain import counts_in
from zenoh_cbef.protocol.keys import address
from zenoh_cbef.protocol.kinds import EventMessage


@dataclass
class Tally:
    """What was counted in a log.

    recorded: messages that are what their key promises; undecodable: the others. agent_bytes: of the recorded
    messages that agents own, but for events. sequences: of the messages of a key's owner; of a key without an owner,
    those of all senders that may use it.
    """

    recorded: int = 0
    undecodable: int = 0
    agent_bytes: int = 0
    sequences: Sequences = field(default_factory=Sequences)

    def hear(self, event: EventMessage) -> None:
        """Take in an event: how many messages a process that ended sent, or which process a recorder lost sight of."""
        told = event.get("data", {})
        if event["kind"] in {"left", "returned"} and event["from"].startswith("record"):
            for (_, sender), sequence in self.sequences:
                if told.get("name") in (sender, f"{sender}/{sender}"):
                    (sequence.cut_off if event["kind"] == "left" else sequence.heal)()
        if event["kind"] == "finished":
            for key, count in counts_in(told, "sent").items():
                at = address(key)
                if at and at.is_of(event["from"]):
                    self.sequences.of(key, event["from"]).tell(count)
