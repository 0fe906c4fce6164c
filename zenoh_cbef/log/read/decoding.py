"""The messages of a log, checked against their keys' fields, and handed on by kind."""

from __future__ import annotations

import gc
from collections.abc import Callable, Collection, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Ints
from zenoh_cbef.log.mcap.contents import RawMessage
from zenoh_cbef.log.mcap.heads import Batch
from zenoh_cbef.log.read.columns import Columns, Reader
from zenoh_cbef.log.read.header import Header
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.log.read.tally import Tally
from zenoh_cbef.protocol.keys import Address, address, agent_named
from zenoh_cbef.protocol.kinds import (
    BEACON,
    ESTIMATE,
    EVENT,
    FAULTS,
    MESSAGE_KINDS,
    RANGE,
    ROUND,
    SIGNAL,
    SMOOTHED,
    TRUTH,
    Envelope,
    EventMessage,
    FaultsMessage,
    Kind,
    M,
    SignalMessage,
)
from zenoh_cbef.protocol.messages import BadMessage, decode_all
from zenoh_cbef.protocol.round_codec import Rounds
from zenoh_cbef.protocol.short import codec_of
from zenoh_cbef.scenario.plan import Plan

Logged = NDArray[np.uint64]

_SEQUENCE = 0xFFFFFFFF
"""What of a number fits into an MCAP record."""
_MISLABELLED = "its record in the file has another number or time"


class Sink:
    """Takes in the messages (m,) of a log, those of one key of a chunk at once, in order. logged: when, ns."""

    def take_truth(self, at: Address, logged: Logged, messages: Columns) -> None:
        """Take the truth."""

    def take_beacons(self, at: Address, logged: Logged, messages: Columns) -> None:
        """Take beacons for an agent."""

    def take_signals(self, at: Address, logged: Logged, messages: Sequence[SignalMessage]) -> None:
        """Take signals to an agent."""

    def take_ranges(self, at: Address, logged: Logged, messages: Columns) -> None:
        """Take ranges of an agent."""

    def take_rounds(self, at: Address, logged: Logged, rounds: Rounds) -> None:
        """Take consensus messages of an agent."""

    def take_estimates(self, at: Address, logged: Logged, messages: Columns) -> None:
        """Take estimates of an agent."""

    def take_smoothed(self, at: Address, logged: Logged, messages: Columns) -> None:
        """Take smoothed estimates of an agent."""

    def take_faults(self, at: Address, logged: Logged, messages: Sequence[FaultsMessage]) -> None:
        """Take lists of injected faults."""

    def take_events(self, at: Address, logged: Logged, messages: Sequence[EventMessage]) -> None:
        """Take events."""


class _Place:
    """One key of the log: what it carries, and the how manieth key it is."""

    def __init__(self, key: str, run: str, plan: Plan, number: int) -> None:
        found = address(key)
        if found is None or found.run != run:
            raise BadMessage("a key that the run does not have")
        if found.agent >= plan.scenario.count:
            raise BadMessage("an agent that the run does not have")
        self.key, self.at, self.kind, self.number = key, found, found.kind, number
        self.of_agent = agent_named(found.owner) is not None and found.kind != "event"
        self.codec = codec_of(run, found.owner, plan.message_size, plan.compact)
        self.reader = Reader(MESSAGE_KINDS[self.kind], run, found.owner)


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
        self._places: dict[str, _Place | BadMessage] = {}
        self._by_kind: dict[str, Callable[[_Place, Batch, Ints], None]] = {
            TRUTH.name: self._columns(sink.take_truth),
            BEACON.name: self._columns(sink.take_beacons),
            SIGNAL.name: self._maps(SIGNAL, sink.take_signals),
            RANGE.name: self._columns(sink.take_ranges),
            ROUND.name: self._take_rounds,
            ESTIMATE.name: self._columns(sink.take_estimates),
            SMOOTHED.name: self._columns(sink.take_smoothed),
            FAULTS.name: self._maps(FAULTS, sink.take_faults),
            EVENT.name: self._maps(EVENT, self._hear),
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

    def take(self, batch: Batch) -> None:
        """Check, count and hand on the messages of a batch: those of one key at once."""
        for _ in self.taking(batch):
            pass

    def taking(self, batch: Batch) -> Iterator[None]:
        """Do the same key by key: each time when those of one are handed on."""
        events = [number for number, channel in batch.channels.items() if self._is_event(channel.topic)]
        begin = 0
        for row in np.flatnonzero(np.isin(batch.channel, events)).tolist():
            # What a process says of its numbers is true of those before.
            yield from self._handing_on(batch, begin, row)
            yield from self._handing_on(batch, row, row + 1)
            begin = row + 1
        yield from self._handing_on(batch, begin, len(batch))

    def _is_event(self, topic: str) -> bool:
        place = self._places.get(topic)
        found = place.at if isinstance(place, _Place) else address(topic)
        return found is not None and found.kind == EVENT.name

    def _handing_on(self, batch: Batch, begin: int, end: int) -> Iterator[None]:
        """Hand on a stretch of a batch."""
        waiting: dict[tuple[float, _Place], list[Ints]] = {}
        # The signals of all agents are one list, in which those of a chunk stand together. Older logs have them among
        # the beacons.
        own_keys = any(channel.topic.endswith(f"/{SIGNAL.name}") for channel in batch.channels.values())
        by_chunk = SIGNAL.name if own_keys else BEACON.name
        for rows in _by_channel(batch.channel, begin, end):
            place = self._place(batch.channels[int(batch.channel[rows[0]])].topic)
            if isinstance(place, BadMessage):
                for row in rows.tolist():
                    self._refuse(batch, row, place)
            elif self._kinds is None or place.kind in self._kinds:
                chunk = batch.chunk[rows] if place.kind == by_chunk else np.zeros(len(rows))
                for each in sorted(set(chunk.tolist())):
                    waiting.setdefault((each, place), []).append(rows[chunk == each])
        for each, place in sorted(waiting, key=lambda one: (one[0], one[1].number)):
            self._take(place, batch, np.sort(np.concatenate(waiting[each, place])))
            yield

    def _place(self, topic: str) -> _Place | BadMessage:
        """What a key is, or why it is none of the run's."""
        found = self._places.get(topic)
        if found is None:
            try:
                found = _Place(topic, self._run, self._plan, len(self._places))
            except BadMessage as error:
                found = error
            self._places[topic] = found
        return found

    def _refuse(self, batch: Batch, row: int, reason: BadMessage) -> None:
        self.tally.undecodable += 1
        self._refused(batch.message(row), reason)

    def _take(self, place: _Place, batch: Batch, rows: Ints) -> None:
        try:
            self._by_kind[place.kind](place, batch, rows)
        except BadMessage as error:
            if len(rows) == 1:
                self._refuse(batch, int(rows[0]), error)
                return
            for half in np.array_split(rows, 2):
                self._take(place, batch, half)
            return
        self.tally.recorded += len(rows)
        if place.of_agent:
            self.tally.agent_bytes += int((batch.end[rows] - batch.start[rows]).sum())

    def _columns(self, take: Callable[[Address, Logged, Columns], None]) -> Callable[[_Place, Batch, Ints], None]:
        """How messages of numbers are checked and handed on. It raises BadMessage."""

        def handed(place: _Place, batch: Batch, rows: Ints) -> None:
            messages = place.reader.read(batch, rows)
            self._check(place, batch, rows, messages)
            take(place.at, batch.log[rows], messages)

        return handed

    def _maps(
        self, kind: Kind[M], take: Callable[[Address, Logged, Sequence[M]], None]
    ) -> Callable[[_Place, Batch, Ints], None]:
        """How messages of words are checked and handed on. It raises BadMessage."""

        def handed(place: _Place, batch: Batch, rows: Ints) -> None:
            messages = decode_all(kind, batch.contents(rows), run=self._run, sender=place.at.owner)
            self._check(place, batch, rows, Columns.of(messages))
            take(place.at, batch.log[rows], messages)

        return handed

    def _hear(self, at: Address, logged: Logged, events: Sequence[EventMessage]) -> None:
        for event in events:
            self.tally.hear(event)
        self._sink.take_events(at, logged, events)

    def _check(self, place: _Place, batch: Batch, rows: Ints, messages: Columns) -> None:
        """Compare messages with the run and with their records, and count their numbers. Raises BadMessage."""
        if "k" in messages.names:
            self._check_steps(int(messages.step.max()), ended=place.kind in {"beacon", "signal"})
        self._check_labels(batch, rows, messages.seq, messages.sent)
        numbers = batch.number[rows]
        for sender, own in messages.by_sender():
            if place.at.is_of(sender):
                self.tally.sequences.of(place.key, sender).take_all(numbers[own].tolist())

    def _take_rounds(self, place: _Place, batch: Batch, rows: Ints) -> None:
        sizes = batch.end[rows] - batch.start[rows]
        found = place.codec.decode_table(batch.table(rows, int(sizes[0]))) if (sizes == sizes[0]).all() else None
        rounds = place.codec.decode_all(batch.contents(rows)) if found is None else found
        self._check_steps(int(rounds.step.max()))
        self._check_labels(batch, rows, rounds.seq.astype(np.int64), rounds.sent.astype(np.int64))
        self.tally.sequences.of(place.key, place.at.owner).take_all(batch.number[rows].tolist())
        self._sink.take_rounds(place.at, batch.log[rows], rounds)

    def _check_labels(self, batch: Batch, rows: Ints, seq: Ints, sent: Ints) -> None:
        if (seq & _SEQUENCE != batch.number[rows]).any() or (sent.astype(np.uint64) != batch.publish[rows]).any():
            raise BadMessage(_MISLABELLED)

    def _check_steps(self, last: int, *, ended: bool = False) -> None:
        # The signal that ends a run is numbered one past its last step.
        if last > self._plan.scenario.length + ended:
            raise BadMessage("a step that the run does not have")


def in_columns(
    take: Callable[[Address, Logged, Columns], None],
) -> Callable[[Address, Logged, Sequence[Envelope]], None]:
    """The same for messages that were read one by one."""
    return lambda at, logged, messages: take(at, logged, Columns.of(messages))


def _by_channel(channel: Ints, begin: int, end: int) -> list[Ints]:
    """The rows of each channel in a stretch, in the order in which channels are met."""
    order = np.argsort(channel[begin:end], kind="stable") + begin
    groups = np.split(order, np.flatnonzero(np.diff(channel[order])) + 1) if len(order) else []
    return sorted(groups, key=lambda rows: int(rows[0]))
