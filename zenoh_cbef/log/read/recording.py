"""A log as arrays: read once, message by message, for all that looks at a run."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np

from zenoh_cbef.log.read.columns import Columns
from zenoh_cbef.log.read.decoding import Decoder, Logged, Sink
from zenoh_cbef.log.read.header import Header, read_header
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.log.read.receipts import Receipts
from zenoh_cbef.log.read.tables import Stamps, Table, stamps_of
from zenoh_cbef.log.read.tally import Tally
from zenoh_cbef.protocol.keys import Address
from zenoh_cbef.protocol.kinds import (
    EventMessage,
    FaultsMessage,
    SignalMessage,
)
from zenoh_cbef.protocol.round_codec import Rounds
from zenoh_cbef.scenario.injected import read_tables, with_faults
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.diagnostics import NAMES

RoundsKept = Literal["none", "times", "payloads"]
"""What is kept of consensus messages, which are most of a log: all are checked and counted."""


class Event(NamedTuple):
    """What a process told. logged, sent: ns since the epoch."""

    logged: int
    sent: int
    message: EventMessage


class Signal(NamedTuple):
    """What the target told an agent: the step, and when step 0 was, s since the epoch. logged, sent: ns."""

    logged: int
    sent: int
    step: int
    at: float | None


class Recording(Sink):
    """The messages of a run, by agent and step, the first of each; n agents, L rounds, payloads of d numbers.

    truth: one row; state (6). beacons: n rows; heard (3): emitted and arrived, s, and the number of the sender in
    `senders`. ranges: n rows; position (3), m. estimates: n rows; state (6), said (the diagnostics), covariance (36).
    smoothed: n rows; state (6), covariance (36), until: the last step whose estimate is in it.
    fields: of any estimate; logs of version 0.1.0 lack most diagnostics. receipts: of each agent. rounds: n L rows,
    agent by agent; payload (d). faults: the last list of injected ones, JSON, or empty. first: when the first message
    was sent, ns; None without any.
    """

    def __init__(self, header: Header, rounds: RoundsKept = "none") -> None:
        plan, scenario = header.plan, header.scenario
        self.header, self.tally = header, Tally()
        self.complete = False
        self.damage: list[str] = []
        count, limit = scenario.count, scenario.length
        self.rounds_per_step = plan.rounds
        self.truth = Table(1, limit, state=6)
        self.beacons = Table(count, limit, heard=3)
        self.ranges = Table(count, limit, position=3)
        self.estimates = Table(count, limit, state=6, said=len(NAMES), covariance=36)
        self.smoothed = Table(count, limit, state=6, covariance=36, until=1)
        self.rounds = Table(count * self.rounds_per_step, limit, payload=plan.message_size)
        self.receipts = [Receipts(limit) for _ in range(count)]
        self.fields: set[str] = set()
        self.senders: dict[str, int] = {}
        self.signals: list[Signal] = []
        self.events: list[Event] = []
        self.faults = ""
        self.first: int | None = None
        self._kept = rounds
        self._plan, self._injected = plan, ""

    @property
    def plan(self) -> Plan:
        """The plan of the run, with the faults that were injected so far."""
        if self.faults != self._injected:
            self._plan, self._injected = with_faults(self.header.plan, read_tables(self.faults)), self.faults
        return self._plan

    @property
    def target_ended(self) -> bool:
        """Whether the target has said that the run is over; one that died has not."""
        return any(one.message["from"] == "target" and one.message["kind"] == "finished" for one in self.events)

    def take_events(self, at: Address, logged: Logged, messages: Sequence[EventMessage]) -> None:  # noqa: ARG002
        """Keep events."""
        stamps = self._stamps(logged, Columns.of(messages))
        self.events += map(Event, stamps.logged.tolist(), stamps.sent.tolist(), messages)

    def take_faults(self, at: Address, logged: Logged, messages: Sequence[FaultsMessage]) -> None:  # noqa: ARG002
        """Keep the last list of injected faults."""
        self._begin(messages[0]["sent"])
        self.faults = messages[-1]["tables"]

    def take_ranges(self, at: Address, logged: Logged, messages: Columns) -> None:
        """Keep where an agent was."""
        position = messages.numbers("position", 3)
        self.ranges.put(at.agent, messages.step, self._stamps(logged, messages), position=position)

    def take_truth(self, at: Address, logged: Logged, messages: Columns) -> None:  # noqa: ARG002
        """Keep the truth."""
        state = messages.numbers("state", 6)
        self.truth.put(0, messages.step, self._stamps(logged, messages), state=state)

    def take_signals(self, at: Address, logged: Logged, messages: Sequence[SignalMessage]) -> None:  # noqa: ARG002
        """Keep signals."""
        stamps = self._stamps(logged, Columns.of(messages))
        for when, sent, one in zip(stamps.logged.tolist(), stamps.sent.tolist(), messages, strict=True):
            self.signals.append(Signal(when, sent, one["k"], one.get("at")))

    def take_rounds(self, at: Address, logged: Logged, rounds: Rounds) -> None:
        """Keep consensus messages of an agent, as far as they are wanted."""
        self._begin(int(rounds.sent[0]))
        if self._kept == "none":
            return
        step, round_ = rounds.step.astype(np.int64), rounds.round.astype(np.int64)
        # A round that the run does not have is put at step 0, which no table has.
        step[(round_ < 1) | (round_ > self.rounds_per_step)] = 0
        row = at.agent * self.rounds_per_step + round_ - 1
        payload = {"payload": rounds.payload} if self._kept == "payloads" else {}
        self.rounds.put(row, step, stamps_of(logged, rounds.sent), **payload)

    def _begin(self, sent: int) -> None:
        if self.first is None:
            self.first = sent

    def _stamps(self, logged: Logged, messages: Columns) -> Stamps:
        self._begin(int(messages.sent[0]))
        return stamps_of(logged, messages.sent)

    def take_beacons(self, at: Address, logged: Logged, messages: Columns) -> None:
        """Keep beacons for an agent."""
        stamps, step = self._stamps(logged, messages), messages.step
        is_beacon = ~messages.has("signal")
        if not is_beacon.all():  # Older logs have no keys for signals.
            moment = messages.numbers("at")[:, 0]
            for place in np.flatnonzero(~is_beacon).tolist():
                told = None if np.isnan(moment[place]) else float(moment[place])
                self.signals.append(Signal(int(stamps.logged[place]), int(stamps.sent[place]), int(step[place]), told))
        names = [name for name, kept in zip(messages.senders(), is_beacon.tolist(), strict=True) if kept]
        for name in dict.fromkeys(names):
            self.senders.setdefault(name, len(self.senders))
        times = [messages.numbers(name)[is_beacon] for name in ("emitted", "arrived")]
        number = np.array([[self.senders[name]] for name in names], dtype=np.float64).reshape(-1, 1)
        heard = np.concatenate([*times, number], axis=1)
        self.beacons.put(at.agent, step[is_beacon], stamps.chosen(is_beacon), heard=heard)

    def take_estimates(self, at: Address, logged: Logged, messages: Columns) -> None:
        """Keep estimates of an agent."""
        stamps, step, agent = self._stamps(logged, messages), messages.step, at.agent
        numbers = {
            "state": messages.numbers("state", 6),
            "said": np.concatenate([messages.numbers(name) for name in NAMES], axis=1),
        }
        if (messages.sizes("covariance") == 36).any():
            numbers["covariance"] = messages.numbers("covariance", 36)
        new = self.estimates.put(agent, step, stamps, **numbers)
        self.fields |= messages.names
        self.receipts[agent].put(step, messages, new)

    def take_smoothed(self, at: Address, logged: Logged, messages: Columns) -> None:
        """Keep smoothed estimates of an agent."""
        self.smoothed.put(
            at.agent,
            messages.step,
            self._stamps(logged, messages),
            state=messages.numbers("state", 6),
            covariance=messages.numbers("covariance", 36),
            until=messages.numbers("until"),
        )


def read_recording(
    log: Log, header: Header | None = None, *, kinds: Collection[str] | None = None, rounds: RoundsKept = "none"
) -> Recording:
    """Read a log, complete or cut off.

    header: where the caller has read it already. kinds: of the messages that are read, None for all. Raises UserError
    where it is no log of a run.
    """
    recording = Recording(header or read_header(log), rounds)
    decoder = Decoder(recording.header, recording, kinds=kinds)
    decoder.take_all(log)
    recording.tally = decoder.tally
    recording.damage = log.damage
    recording.complete = log.complete and not recording.damage
    return recording


def filling_recording(log: Log, kinds: Collection[str]) -> tuple[Recording, Iterator[None]]:
    """A recording that is still empty, and what fills it, some messages of one key each time. Raises UserError."""
    recording = Recording(read_header(log))
    decoder = Decoder(recording.header, recording, kinds=kinds)

    def fill() -> Iterator[None]:
        for batch in log.batches():
            yield from decoder.taking(batch)

    return recording, fill()
