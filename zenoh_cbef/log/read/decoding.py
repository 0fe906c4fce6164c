"""The messages of a log, checked against their keys' fields, and handed on by kind."""

from __future__ import annotations

import gc
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial

from zenoh_cbef.log.common.sequence import Sequences
from zenoh_cbef.log.mcap.contents import RawMessage
from zenoh_cbef.log.read.header import Header
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.plain import counts_in
from zenoh_cbef.protocol.keys import Address, address, agent_named
from zenoh_cbef.protocol.kinds import (
    BEACON,
    ESTIMATE,
    EVENT,
    FAULTS,
    RANGE,
    ROUND,
    SIGNAL,
    SMOOTHED,
    TRUTH,
    BeaconMessage,
    Envelope,
    EstimateMessage,
    EventMessage,
    FaultsMessage,
    Kind,
    M,
    RangeMessage,
    SignalMessage,
    SmoothedMessage,
    TruthMessage,
)
from zenoh_cbef.protocol.messages import BadMessage, decode_all
from zenoh_cbef.protocol.round_codec import Rounds
from zenoh_cbef.protocol.short import codec_of
from zenoh_cbef.scenario.plan import Plan

Logged = Sequence[int]

_SEQUENCE = 0xFFFFFFFF
"""What of a number fits into an MCAP record."""
_MISLABELLED = "its record in the file has another number or time"


class Sink:
    """Takes in the messages (m,) of a log, those of one key of a chunk at once, in order. logged: when, ns."""

    def take_truth(self, at: Address, logged: Logged, messages: Sequence[TruthMessage]) -> None:
        """Take the truth."""

    def take_beacons(self, at: Address, logged: Logged, messages: Sequence[BeaconMessage]) -> None:
        """Take beacons for an agent."""

    def take_signals(self, at: Address, logged: Logged, messages: Sequence[SignalMessage]) -> None:
        """Take signals to an agent."""

    def take_ranges(self, at: Address, logged: Logged, messages: Sequence[RangeMessage]) -> None:
        """Take ranges of an agent."""

    def take_rounds(self, at: Address, logged: Logged, rounds: Rounds) -> None:
        """Take consensus messages of an agent."""

    def take_estimates(self, at: Address, logged: Logged, messages: Sequence[EstimateMessage]) -> None:
        """Take estimates of an agent."""

    def take_smoothed(self, at: Address, logged: Logged, messages: Sequence[SmoothedMessage]) -> None:
        """Take smoothed estimates of an agent."""

    def take_faults(self, at: Address, logged: Logged, messages: Sequence[FaultsMessage]) -> None:
        """Take lists of injected faults."""

    def take_events(self, at: Address, logged: Logged, messages: Sequence[EventMessage]) -> None:
        """Take events."""


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
        self.codec = codec_of(run, found.owner, plan.message_size, plan.compact)
        self.waiting: list[RawMessage] = []


def _ignore(*_: object) -> None:
    """Ignore an invalid message: it is counted elsewhere, which is enough for most readers."""


_NOWHERE = Sink()


class Decoder:
    """Hands the messages of a run to a sink and counts them.

    kinds: of messages that are looked at, None for all. refused: told of what is not as its key promises.
    """

    def __init__(
        self,
        header: Header,
        sink: Sink = _NOWHERE,
        *,
        kinds: Collection[str] | None = None,
        refused: Callable[[RawMessage, BadMessage], None] = _ignore,
    ) -> None:
        self.tally = Tally()
        self._run, self._plan = header.run, header.plan
        self._sink, self._kinds, self._refused = sink, kinds, refused
        self._places: list[_Place] = []
        self._takers: dict[str, Callable[[RawMessage], None]] = {}
        self._by_kind: dict[str, Callable[[_Place, list[RawMessage]], None]] = {
            TRUTH.name: self._handing(TRUTH, sink.take_truth),
            BEACON.name: self._handing(BEACON, sink.take_beacons),
            SIGNAL.name: self._handing(SIGNAL, sink.take_signals),
            RANGE.name: self._handing(RANGE, sink.take_ranges),
            ROUND.name: self._take_rounds,
            ESTIMATE.name: self._handing(ESTIMATE, sink.take_estimates),
            SMOOTHED.name: self._handing(SMOOTHED, sink.take_smoothed),
            FAULTS.name: self._handing(FAULTS, sink.take_faults),
            EVENT.name: self._handing(EVENT, self._hear),
        }

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
        for _ in self.taking(batch):
            pass

    def taking(self, batch: list[RawMessage]) -> Iterator[None]:
        """Do the same key by key: each time when those of one are handed on."""
        takers = self._takers
        for raw in batch:
            topic = raw.channel.topic
            (takers.get(topic) or self._taker(topic))(raw)
        yield from self._handing_on()

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
        for _ in self._handing_on():
            pass
        self._take(place, [raw])

    def _handing_on(self) -> Iterator[None]:
        for place in self._places:
            if place.waiting:
                self._take(place, place.waiting)
                place.waiting.clear()
                yield

    def _refuse(self, raw: RawMessage, reason: BadMessage) -> None:
        self.tally.undecodable += 1
        self._refused(raw, reason)

    def _take(self, place: _Place, batch: list[RawMessage]) -> None:
        try:
            self._by_kind[place.kind](place, batch)
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

    def _handing(
        self, kind: Kind[M], take: Callable[[Address, Logged, Sequence[M]], None]
    ) -> Callable[[_Place, list[RawMessage]], None]:
        """How messages of a kind are checked and handed on. It raises BadMessage."""

        def handed(place: _Place, batch: list[RawMessage]) -> None:
            _, logged, _, _, data = zip(*batch, strict=True)
            messages = decode_all(kind, data, run=self._run, sender=place.at.owner)
            self._check(place, batch, messages)
            take(place.at, logged, messages)

        return handed

    def _hear(self, at: Address, logged: Logged, events: Sequence[EventMessage]) -> None:
        for event in events:
            self.tally.hear(event)
        self._sink.take_events(at, logged, events)

    def _check(self, place: _Place, batch: list[RawMessage], messages: Sequence[Envelope]) -> None:
        """Compare messages with the run and with their records, and count their numbers. Raises BadMessage."""
        _, _, times, numbers, _ = zip(*batch, strict=True)
        steps = (step for one in messages if isinstance(step := one.get("k"), int))
        self._check_steps(max(steps, default=0), ended=place.kind in {"beacon", "signal"})
        labels = [(message["seq"] & _SEQUENCE, message["sent"]) for message in messages]
        if labels != [*zip(numbers, times, strict=True)]:
            raise BadMessage(_MISLABELLED)
        for sender in dict.fromkeys(message["from"] for message in messages):
            own = [n for n, message in zip(numbers, messages, strict=True) if message["from"] == sender]
            if place.at.is_of(sender):
                self.tally.sequences.of(place.key, sender).take_all(own)

    def _take_rounds(self, place: _Place, batch: list[RawMessage]) -> None:
        _, logged, times, numbers, data = zip(*batch, strict=True)
        rounds = place.codec.decode_all(data)
        self._check_steps(int(rounds.step.max()))
        if (rounds.seq & _SEQUENCE).tolist() != [*numbers] or rounds.sent.tolist() != [*times]:
            raise BadMessage(_MISLABELLED)
        self.tally.sequences.of(place.key, place.at.owner).take_all([*numbers])
        self._sink.take_rounds(place.at, logged, rounds)

    def _check_steps(self, last: int, *, ended: bool = False) -> None:
        # The signal that ends a run is numbered one past its last step.
        if last > self._plan.scenario.length + ended:
            raise BadMessage("a step that the run does not have")
