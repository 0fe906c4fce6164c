"""The messages of a log, checked against what their keys promise, and handed on by what they are."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

from zenoh_cbef.log.mcap.contents import RawMessage
from zenoh_cbef.log.parts import Log
from zenoh_cbef.log.sequence import Sequence
from zenoh_cbef.protocol.keys import address, agent_of
from zenoh_cbef.protocol.messages import BadMessage, decode_all
from zenoh_cbef.protocol.round_codec import RoundCodec, Rounds
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.build import message_size

_SEQUENCE = 0xFFFFFFFF
"""What of a number fits into an MCAP record."""
_MISLABELLED = "its record in the file has another number or time"


class Sink(Protocol):
    """Takes in the messages of a log."""

    def take(self, kind: str, agent: int, messages: list[dict[str, Any]]) -> None:
        """Take some messages of one key, in order, that are no round messages. agent: whose key, -1 for no agent's."""

    def take_rounds(self, agent: int, rounds: Rounds) -> None:
        """Take some consensus messages of an agent, in order."""


@dataclass
class Tally:
    """What was counted in a log.

    recorded: messages that are what their key promises; undecodable: the others. agent_bytes: of the recorded
    messages that agents own. sequences: by key and sender.
    """

    recorded: int = 0
    undecodable: int = 0
    agent_bytes: int = 0
    sequences: dict[tuple[str, str], Sequence] = field(default_factory=dict)

    def sequence(self, key: str, sender: str) -> Sequence:
        """The numbers of a sender on a key."""
        found = self.sequences.get((key, sender))
        if found is None:
            found = self.sequences[key, sender] = Sequence()
        return found

    def hear(self, event: dict[str, Any]) -> None:
        """Take the word of a process that ended for how many messages it sent on each of its keys."""
        sent = event.get("data", {}).get("sent")
        if event["kind"] == "finished" and isinstance(sent, dict):
            for key, count in sent.items():
                if isinstance(key, str) and type(count) is int and count >= 0:
                    self.sequence(key, event["from"]).tell(count)


class _Place:
    """One key of the log: what it carries, and its round messages of the present batch."""

    def __init__(self, key: str, run: str, scenario: Scenario) -> None:
        found = address(key)
        if found is None or key.split("/")[1] != run:
            raise BadMessage("a key that the run does not have")
        self.key, self.kind, self.owner = key, found.kind, found.owner
        self.agent = -1 if found.kind in ("event", "truth", "faults") else agent_of(key)
        if self.agent >= scenario.count:
            raise BadMessage("an agent that the run does not have")
        self.codec = RoundCodec(run, found.owner, message_size(scenario)) if found.kind == "round" else None
        self.waiting: list[RawMessage] = []


def _ignore(raw: RawMessage, reason: BadMessage) -> None:
    """What is not as promised is counted, which is enough for most."""


class Decoder:
    """Hands the messages of a run to a sink, and counts them. refused is told of what is not as its key promises."""

    def __init__(
        self,
        run: str,
        scenario: Scenario,
        sink: Sink,
        refused: Callable[[RawMessage, BadMessage], None] = _ignore,
    ) -> None:
        self.tally = Tally()
        self._run, self._scenario, self._sink, self._refused = run, scenario, sink, refused
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
            place = _Place(topic, self._run, self._scenario)
        except BadMessage as error:
            taker = partial(self._refuse, reason=error)
        else:
            self._places.append(place)
            taker = partial(self._take_event, place) if place.kind == "event" else place.waiting.append
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
        if place.owner.startswith("agent/"):
            self.tally.agent_bytes += sum(map(len, list(zip(*batch, strict=True))[-1]))

    def _take_messages(self, place: _Place, batch: list[RawMessage]) -> None:
        _, _, times, numbers, data = zip(*batch, strict=True)
        messages = decode_all(place.kind, data, run=self._run, sender=place.owner)
        labels = [(message["seq"] & _SEQUENCE, message["sent"]) for message in messages]
        if labels != [*zip(numbers, times, strict=True)]:
            raise BadMessage(_MISLABELLED)
        for sender in dict.fromkeys(message["from"] for message in messages):
            own = [n for n, message in zip(numbers, messages, strict=True) if message["from"] == sender]
            self.tally.sequence(place.key, sender).take_all(own)
        if place.kind == "event":
            for message in messages:
                self.tally.hear(message)
        self._sink.take(place.kind, place.agent, messages)

    def _take_rounds(self, place: _Place, codec: RoundCodec, batch: list[RawMessage]) -> None:
        _, _, times, numbers, data = zip(*batch, strict=True)
        rounds = codec.decode_all(data)
        if (rounds.seq & _SEQUENCE).tolist() != [*numbers] or rounds.sent.tolist() != [*times]:
            raise BadMessage(_MISLABELLED)
        self.tally.sequence(place.key, place.owner).take_all([*numbers])
        self._sink.take_rounds(place.agent, rounds)
