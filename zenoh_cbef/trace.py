"""One run as arrays: the simulator and the log reader make it, the analysis reads it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Self

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ints
from zenoh_cbef.faults import Fate
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.smoothing import Smoothed


@dataclass(frozen=True)
class Links:
    """Messages on every directed link, arrays (e,).

    sent: published by the source while it ran. delivered: in time. lost: never came, came after the receiver's last
    count, or were rejected as damaged. late: came after their round. injected_lost, injected_late: those of them that
    the scenario's faults lost or delayed. corrupted: damaged by faults and rejected. duplicated: delivered, and brought
    twice by faults. latency: mean time from sending to use, s; NaN where unknown.
    """

    source: Ints
    destination: Ints
    sent: Ints
    delivered: Ints
    lost: Ints
    late: Ints
    injected_lost: Ints
    injected_late: Ints
    corrupted: Ints
    duplicated: Ints
    latency: Floats

    @property
    def real_lost(self) -> Ints:
        """Lost without a fault of the scenario: gaps in the numbers of the messages that came."""
        return self.lost - self.injected_lost - self.corrupted

    @property
    def deadline_missed(self) -> Ints:
        """Late without a fault of the scenario."""
        return self.late - self.injected_late

    @property
    def missed(self) -> float | None:
        """The share of all messages that were not delivered; None where none was sent."""
        sent = int(self.sent.sum())
        return (sent - int(self.delivered.sum())) / sent if sent else None


@dataclass(frozen=True)
class Passing:
    """Messages on every directed link over time; e links in the order of `Links`, B stretches of steps.

    until: (B,), the last step of each stretch. counts: (e, B, 4): messages that came in time, were lost and late, and
    their mean latency, s; NaN where the receiver said nothing.
    """

    until: Ints
    counts: Floats


class LinkCounts:
    """Messages per directed link (e,), the present ones of (N, m) in order, as the receivers count them."""

    def __init__(self, present: Bools) -> None:
        self._present = present
        self._sent = 0
        self._fates = {
            name: np.zeros(present.sum(), dtype=np.int64)
            for name in ("absent", "lost", "late", "corrupted", "duplicated")
        }

    def sent(self) -> None:
        """Count one message sent by every neighbour."""
        self._sent += 1

    def add(self, fate: Fate) -> None:
        """Count the fates of messages, arrays (e,)."""
        for name in self._fates:
            struck = getattr(fate, name)
            if np.count_nonzero(struck):
                self._fates[name] += struck

    @property
    def delivered(self) -> Ints:
        """Messages that arrived in time and whole, by link (e,)."""
        struck = sum(self._fates[name] for name in ("absent", "lost", "late", "corrupted"))
        return np.asarray(self._sent - struck, dtype=np.int64)

    def links(self, mine: slice, source: Ints, destination: Ints) -> Links:
        """The counts of one run's links."""
        first = int(self._present[: mine.start].sum())
        chosen = slice(first, first + len(source))
        absent, lost, late, corrupted, duplicated = (count[chosen] for count in self._fates.values())
        sent = self._sent - absent
        return Links(
            source=source,
            destination=destination,
            sent=sent,
            delivered=sent - lost - corrupted - late,
            lost=lost + corrupted,
            late=late,
            injected_lost=lost,
            injected_late=late,
            corrupted=corrupted,
            duplicated=duplicated,
            latency=np.full(len(sent), np.nan),
        )


@dataclass(frozen=True)
class Traffic:
    """Messages of a whole run: sent (by sequence numbers), recorded, missing from the log, and rejected.

    agent_bytes: of the agents' recorded messages together, as they were encoded. gaps: by key, first and last of the
    numbers that are missing, up to a thousand stretches of each sender. agents_missing: those of `missing` that agents
    sent.
    """

    sent: int
    recorded: int
    missing: int
    rejected: int
    agent_bytes: int = 0
    agents_missing: int = 0
    gaps: dict[str, list[tuple[int, int]]] = field(default_factory=dict)


@dataclass(frozen=True)
class SmoothedPath:
    """What later estimates say of each step: states (n, K, 6), covariances (n, K, 6, 6); NaN where there is nothing.

    lag: by how many steps each waited for later ones, at most.
    """

    states: Floats
    covariances: Floats
    lag: int

    @classmethod
    def empty(cls, rows: int, steps: int, lag: int) -> Self:
        """Nothing yet."""
        return cls(np.full((rows, steps, 6), np.nan), np.full((rows, steps, 6, 6), np.nan), lag)

    def put(self, told: Iterable[Smoothed], absent: Bools) -> None:
        """Take in what agents say, but for those that are not there to say it, (n,)."""
        for one in told:
            rows = one.known & ~absent
            self.states[rows, one.step - 1] = one.state[rows]
            self.covariances[rows, one.step - 1] = one.covariance[rows]

    def of(self, mine: slice | Ints) -> Self:
        """Some rows of it."""
        return replace(self, states=self.states[mine], covariances=self.covariances[mine])


@dataclass(frozen=True)
class Trace:
    """One run. Row k-1 of a step axis is step k; n agents, K steps.

    time: (K,), s. truth: (K, 6). positions: (n, K, 3). ranges: (n, K), m. age: (n, K), s, of each range at its
    step. initial: (n, 6), before step 1's update. estimates: (n, K, 6). covariances: (n, K, 6, 6).
    diagnostics: (n, K) each. edges: (m, 2). NaN where there is nothing. payloads, where kept: (n, K, L, d), as sent.
    smoothed: None where the agents did not smooth. passing: None where no log tells.
    events: what nodes reported, in order. unlogged: (n, K), measurements that were made, or may have been, and are not
    in `ranges`; None where there are none. told: whether the nodes' reports are there. complete: the log was closed,
    the run ended as planned, and nothing of it is missing. stopped: it was closed, nothing is missing, but the run was
    stopped before its planned end. agents: (n,), by their numbers, of whom the rows are; None: of all.
    """

    name: str
    plan: Plan
    time: Floats
    truth: Floats
    positions: Floats
    ranges: Floats
    age: Floats
    initial: Floats
    estimates: Floats
    covariances: Floats
    diagnostics: Diagnostics
    edges: Ints
    links: Links
    traffic: Traffic
    payloads: Floats | None = None
    smoothed: SmoothedPath | None = None
    events: list[dict[str, object]] = field(default_factory=list)
    unlogged: Bools | None = None
    told: bool = True
    complete: bool = True
    stopped: bool = False
    passing: Passing | None = None
    agents: Ints | None = None

    @property
    def scenario(self) -> Scenario:
        """What the run was to be."""
        return self.plan.scenario

    @property
    def source_time(self) -> Floats | None:
        """The steps' times on the clock of the recording that the ranges are of, (K,), s; None for other ranges."""
        origin = self.scenario.target.origin
        return None if origin is None else origin + self.time

    @property
    def range_time(self) -> Floats:
        """When each range was measured, (n, K), s, on the same clock; run time for other ranges than recorded ones."""
        time = self.time if self.source_time is None else self.source_time
        return np.where(np.isfinite(self.ranges), time - self.age, np.nan)

    @property
    def measured_steps(self) -> int:
        """How many steps there are before the first of which a measurement is unlogged."""
        if self.unlogged is None or not self.unlogged.any():
            return len(self.time)
        return int(self.unlogged.any(axis=0).argmax())


Fortune = Literal["in time", "duplicated", "lost", "late", "damaged", "missed", "unheard"]
"""The end of a message: a fault duplicated, lost, delayed or damaged it; missed: lost or late without a fault."""


@dataclass(frozen=True)
class Passage:
    """One message on one directed link; source None: a beacon of the target.

    round: from 1, 0 for ranges and beacons. sent: s. ended: when it was used, or came too late, or would have been
    used, s.
    """

    source: int | None
    destination: int
    step: int
    round: int
    sent: float
    ended: float
    fortune: Fortune


def began(events: Sequence[Mapping[str, object]]) -> float | None:
    """When the target started the run, s since the epoch; None where no event says so."""
    told = (event.get("data") for event in events if event.get("kind") == "started")
    at = next((data["at"] for data in told if isinstance(data, Mapping) and "at" in data), None)
    return float(at) if isinstance(at, float | int) else None


@dataclass(frozen=True)
class Exchange:
    """What passed between the nodes in a part of a run; times in s since its start.

    labels: of the agents. dt: s. since, until: the part. passages: by sending time. rounds: when half of the agents
    had sent in each round, (step, round, time), in order; round 0 is where a step begins. estimates: (agent, step,
    time). events: (node, time, sentence). notes: what a reader should know of the times, in sentences.
    """

    name: str
    labels: tuple[str, ...]
    dt: float
    since: float
    until: float
    passages: list[Passage]
    rounds: list[tuple[int, int, float]]
    estimates: list[tuple[int, int, float]]
    events: list[tuple[str, float, str]]
    notes: list[str]
