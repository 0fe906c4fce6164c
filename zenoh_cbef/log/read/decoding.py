"""The messages of a log, checked against their keys' fields, and handed on by kind."""

from __future__ import annotations

import gc
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from zenoh_cbef.log.common.sequence import Sequences
from zenoh_cbef.log.mcap.contents import RawMessage
from zenoh_cbef.log.read.header import Header
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.plain import counts_in
from zenoh_cbef.protocol.keys import Address, address, agent_named
from zenoh_cbef.protocol.kinds import EstimateMessage, EventMessage
from zenoh_cbef.protocol.messages import BadMessage, Message, decode_all
from zenoh_cbef.protocol.round_codec import RoundCodec, Rounds
from zenoh_cbef.scenario.plan import Plan

_SEQUENCE = 0xFFFFFFFF
"""What of a number fits into an MCAP record."""
_MISLABELLED = "its record in the file has another number or time"


class Sink(Protocol):
    """Takes in the messages of a log, those of one key of a chunk at once, in order. logged: their log times, ns."""

    def take(self, at: Address, logged: Sequence[int], messages: Sequence[Message]) -> None:
        """Take messages (m,) of the target, or ranges."""

    def take_events(self, logged: Sequence[int], messages: Sequence[EventMessage]) -> None:
        """Take events."""

    def take_estimates(self, at: Address, logged: Sequence[int], messages: Sequence[EstimateMessage]) -> None:
        """Take estimates of an agent."""

    def take_rounds(self, at: Address, logged: Sequence[int], rounds: Rounds) -> None:
        """Take consensus messages of an agent."""


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


class _Place:
    """One key of the log: what it carries, and its messages of the present batch."""

    def __init__(self, key: str, run: str, plan: Plan) -> None:
        found = address(key)
        if found is None or found.run != run:
            raise BadMessage("a key that the run does not have")
        if found.agent >= plan.scenario.count:
            raise BadMessage("an agent that the run does not have")
        self.key, self.at, self.kind = key, found, found.kind
        self.of_agent = agent_named(found.owner) is not None and found.kind != "event"
        self.codec = RoundCodec(run, found.owner, plan.message_size) if found.kind == "round" else None
        self.waiting: list[RawMessage] = []


def _ignore(*_: object) -> None:
    """Ignore an invalid message: it is counted elsewhere, which is enough for most readers."""


class Decoder:
    """Hands the messages of a run to a sink, if there is one, and counts them.

    kinds: of messages that are looked at, None for all. refused: told of what is not as its key promises.
    """

    def __init__(
        self,
        header: Header,
        sink: Sink | None = None,
        *,
        kinds: Collection[str] | None = None,
        refused: Callable[[RawMessage, BadMessage], None] = _ignore,
    ) -> None:
        self.tally = Tally()
        self._run, self._plan = header.run, header.plan
        self._sink, self._kinds, self._refused = sink, kinds, refused
        self._places: list[_Place] = []
        self._takers: dict[str, Callable[[RawMessage], None]] = {}

    def take_all(self, log: Log) -> None:
        """Take all messages of a log."""
        collecting = gc.isenabled()
        # Messages form no circles: looking for them takes a tenth of the time.
        gc.disable()
        try:
            for batch in log.batches():
                self.take(batch)
        finally:
            if collecting:
                gc.enable()

    def take(self, batch: list[RawMessage]) -> None:
        """Check, count and hand on the messages of a batch: those of one key at once."""
        takers = self._takers
        for raw in batch:
            topic = raw.channel.topic
            (takers.get(topic) or self._taker(topic))(raw)
        self._hand_on()

    def _taker(self, topic: str) -> Callable[[RawMessage], None]:
        """What to do with a message of a key."""
        taker: Callable[[RawMessage], None]
        try:
            place = _Place(topic, self._run, self._plan)
        except BadMessage as error:
            taker = partial(self._refuse, reason=error)
        else:
            self._places.append(place)
            taker = partial(self._take_event, place) if place.kind == "event" else place.waiting.append
            if self._kinds is not None and place.kind not in self._kinds:
                taker = _ignore
        self._takers[topic] = taker
        return taker

    def _take_event(self, place: _Place, raw: RawMessage) -> None:
        # What a process says of its numbers is true of those before.
        self._hand_on()
        self._take(place, [raw])

    def _hand_on(self) -> None:
        for place in self._places:
            if place.waiting:
                self._take(place, place.waiting)
                place.waiting.clear()

    def _refuse(self, raw: RawMessage, reason: BadMessage) -> None:
        self.tally.undecodable += 1
        self._refused(raw, reason)

    def _take(self, place: _Place, batch: list[RawMessage]) -> None:
        try:
            if place.codec is None:
                self._take_messages(place, batch)
            else:
                self._take_rounds(place, place.codec, batch)
        except BadMessage as error:
            if len(batch) == 1:
                self._refuse(batch[0], error)
                return
            for raw in batch:
                self._take(place, [raw])
            return
        self.tally.recorded += len(batch)
        if place.of_agent:
            self.tally.agent_bytes += sum(map(len, list(zip(*batch, strict=True))[-1]))

    def _take_messages(self, place: _Place, batch: list[RawMessage]) -> None:
        _, logged, _, _, data = zip(*batch, strict=True)
        sink, run, owner = self._sink, self._run, place.at.owner
        if place.kind == "event":
            events = decode_all("event", data, run=run, sender=owner)
            self._check(place, batch, events)
            for event in events:
                self.tally.hear(event)
            if sink is not None:
                sink.take_events(logged, events)
        elif place.kind == "estimate":
            estimates = decode_all("estimate", data, run=run, sender=owner)
            self._check(place, batch, estimates)
            if sink is not None:
                sink.take_estimates(place.at, logged, estimates)
        else:
            messages = decode_all(place.kind, data, run=run, sender=owner)
            self._check(place, batch, messages)
            if sink is not None:
                sink.take(place.at, logged, messages)

    def _check(self, place: _Place, batch: list[RawMessage], messages: Sequence[Message]) -> None:
        """Compare messages with the run and with their records, and count their numbers. Raises BadMessage."""
        _, _, times, numbers, _ = zip(*batch, strict=True)
        self._check_steps(max(message.get("k", 0) for message in messages), ended=place.kind in {"beacon", "signal"})
        labels = [(message["seq"] & _SEQUENCE, message["sent"]) for message in messages]
        if labels != [*zip(numbers, times, strict=True)]:
            raise BadMessage(_MISLABELLED)
        for sender in dict.fromkeys(message["from"] for message in messages):
            own = [n for n, message in zip(numbers, messages, strict=True) if message["from"] == sender]
            if place.at.is_of(sender):
                self.tally.sequences.of(place.key, sender).take_all(own)

    def _take_rounds(self, place: _Place, codec: RoundCodec, batch: list[RawMessage]) -> None:
        _, logged, times, numbers, data = zip(*batch, strict=True)
        rounds = codec.decode_all(data)
        self._check_steps(int(rounds.step.max()))
        if (rounds.seq & _SEQUENCE).tolist() != [*numbers] or rounds.sent.tolist() != [*times]:
            raise BadMessage(_MISLABELLED)
        self.tally.sequences.of(place.key, place.at.owner).take_all([*numbers])
        if self._sink is not None:
            self._sink.take_rounds(place.at, logged, rounds)

    def _check_steps(self, last: int, *, ended: bool = False) -> None:
        # The signal that ends a run is numbered one past its last step.
        if last > self._plan.scenario.length + ended:
            raise BadMessage("a step that the run does not have")
