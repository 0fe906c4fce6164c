"""The kinds of messages, each as it is after it was read and checked: the one list of what crosses the network."""

from __future__ import annotations

from dataclasses import replace
from typing import NotRequired, TypedDict

from zenoh_cbef.protocol.fields import (
    Count,
    Counts,
    Doubles,
    DoublesOrNil,
    Field,
    Matrix,
    Moment,
    NumberOrNil,
    NumbersOrNil,
    Signal,
    Six,
    SmallCount,
    Table,
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


class TruthMessage(Envelope):
    """The target's state in a step."""

    k: Count
    state: Six


class BeaconMessage(Envelope):
    """When a beacon was emitted and heard, s; nil where it was not.

    signal, at: in older logs, which have no key for signals.
    """

    k: Count
    emitted: NumberOrNil
    arrived: NumberOrNil
    signal: NotRequired[Signal]
    at: NotRequired[Moment]


class SignalMessage(Envelope):
    """The run begins after a step, or ends before it. at: when step 0 is or was, s since the Unix epoch."""

    k: Count
    signal: Signal
    at: NotRequired[Moment]


class RangeMessage(Envelope):
    """Where an agent is, m, and the range that it measured, m."""

    k: Count
    position: Three
    range: NumberOrNil


class RoundMessage(Envelope):
    """A payload of a round of consensus."""

    k: Count
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


class _StateMessage(Envelope):
    k: Count
    state: Six


class EstimateMessage(_StateMessage, LinkCounts):
    """An agent's estimate, besides its diagnostics, whose list tracking/diagnostics.py is."""

    covariance: DoublesOrNil


class SmoothedMessage(Envelope):
    """An agent's estimate of an earlier step; until: the last step whose estimate is in it."""

    k: Count
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


def _body(shape: type) -> dict[str, Field]:
    return {name: field for name, field in fields_of(shape).items() if name not in ENVELOPE}


BODIES: dict[str, dict[str, Field]] = {
    "truth": _body(TruthMessage),
    "beacon": _body(BeaconMessage),
    "signal": _body(SignalMessage),
    "range": _body(RangeMessage),
    "round": _body(RoundMessage),
    "estimate": {**_body(_StateMessage), **_DIAGNOSTICS, **_body(EstimateMessage)},
    "smoothed": _body(SmoothedMessage),
    "faults": _body(FaultsMessage),
    "event": _body(EventMessage),
}
"""The fields of each kind of message, besides those of the envelope."""
