"""The kinds of messages, each as it is after it was read and checked: the one list of what crosses the network."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Generic, NotRequired, TypedDict, TypeVar

from zenoh_cbef.protocol.fields import (
    Count,
    Counts,
    Doubles,
    DoublesOrNil,
    Field,
    Flag,
    Matrix,
    Moment,
    NumberOrNil,
    NumbersOrNil,
    Signal,
    Six,
    SmallCount,
    Table,
    Test,
    Text,
    Texts,
    Three,
    field_of,
    fields_of,
)
from zenoh_cbef.tracking import diagnostics

Envelope = TypedDict("Envelope", {"v": Count, "run": Text, "from": Text, "seq": Count, "sent": Count})
"""What every message has: protocol version, run, sender (as in "agent/3"), number (per key, from 0), and when it was
sent, ns since the Unix epoch."""


class StepMessage(Envelope):
    """What belongs to a step."""

    k: Count


class TruthMessage(StepMessage):
    """The target's state in a step."""

    state: Six


class BeaconMessage(StepMessage):
    """When a beacon was emitted and heard, s; nil where it was not.

    lists: how many lists of injected faults the target had published before, where there are any: in lockstep the agent
    takes them in before it begins the step. by_rounds: in lockstep the agent waits before each round of the step for a
    signal. signal, at: in older logs, which have no key for signals.
    """

    emitted: NumberOrNil
    arrived: NumberOrNil
    lists: NotRequired[Count]
    by_rounds: NotRequired[Flag]
    signal: NotRequired[Signal]
    at: NotRequired[Moment]


class SignalMessage(StepMessage):
    """The run begins after a step, or ends before it, or agents may make rounds of it.

    at: when step 0 is or was, s since the Unix epoch. l: the last round that they may make.
    """

    signal: Signal
    l: NotRequired[Count]  # noqa: E741 - the field's name in messages and logs
    at: NotRequired[Moment]


class RangeMessage(StepMessage):
    """Where an agent is, m, and the range that it measured, m."""

    position: Three
    range: NumberOrNil


class RoundMessage(StepMessage):
    """A payload of a round of consensus."""

    l: Count  # noqa: E741 - the field's name in messages and logs
    payload: Doubles


class LinkCounts(TypedDict):
    """What became of the neighbours' messages since the start, a number for each neighbour; fates: of this step."""

    neighbours: Counts
    received: Counts
    lost: Counts
    late: Counts
    injected_lost: NotRequired[Counts]
    injected_late: NotRequired[Counts]
    corrupted: NotRequired[Counts]
    duplicated: NotRequired[Counts]
    fates: NotRequired[Texts]
    latency: NumbersOrNil


class _StateMessage(StepMessage):
    state: Six


class EstimateMessage(_StateMessage, LinkCounts):
    """An agent's estimate, besides its diagnostics, whose list tracking/diagnostics.py is."""

    covariance: DoublesOrNil


class SmoothedMessage(StepMessage):
    """An agent's estimate of an earlier step; until: the last step whose estimate is in it."""

    until: SmallCount
    state: Six
    covariance: Matrix


class FaultsMessage(Envelope):
    """All faults that were injected, as JSON."""

    tables: Text


class EventMessage(Envelope):
    """What happened to a process, for programs and in words."""

    kind: Text
    text: Text
    data: NotRequired[Table]


_EARLY = frozenset({"innovation", "weight"})
"""The diagnostics that logs of version 0.1.0 have; all others are optional."""

_DIAGNOSTICS = {
    name: replace(field_of(Count if name in diagnostics.WHOLE else NumberOrNil), optional=name not in _EARLY)
    for name in diagnostics.NAMES
}

ENVELOPE = fields_of(Envelope)

M = TypeVar("M", bound=Envelope)
M_co = TypeVar("M_co", bound=Envelope, covariant=True)


@dataclass(frozen=True)
class Kind(Generic[M_co]):
    """A kind of message. fields: with those of the envelope.

    required: what no message of it may lack. tests: of these, each with the names of all fields that have to pass it.
    """

    name: str
    fields: dict[str, Field]
    required: frozenset[str] = field(init=False)
    tests: dict[Test, list[str]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Find what is required."""
        required = sorted(name for name, one in self.fields.items() if not one.optional)
        object.__setattr__(self, "required", frozenset(required))
        for name in required:
            self.tests.setdefault(self.fields[name].hold, []).append(name)


TRUTH = Kind[TruthMessage]("truth", fields_of(TruthMessage))
BEACON = Kind[BeaconMessage]("beacon", fields_of(BeaconMessage))
SIGNAL = Kind[SignalMessage]("signal", fields_of(SignalMessage))
RANGE = Kind[RangeMessage]("range", fields_of(RangeMessage))
ROUND = Kind[RoundMessage]("round", fields_of(RoundMessage))
ESTIMATE = Kind[EstimateMessage]("estimate", {**fields_of(_StateMessage), **_DIAGNOSTICS, **fields_of(EstimateMessage)})
SMOOTHED = Kind[SmoothedMessage]("smoothed", fields_of(SmoothedMessage))
FAULTS = Kind[FaultsMessage]("faults", fields_of(FaultsMessage))
EVENT = Kind[EventMessage]("event", fields_of(EventMessage))
_ALL: tuple[Kind[Envelope], ...] = (TRUTH, BEACON, SIGNAL, RANGE, ROUND, ESTIMATE, SMOOTHED, FAULTS, EVENT)
MESSAGE_KINDS = {kind.name: kind for kind in _ALL}
"""The kinds of messages by the last part of their keys."""
