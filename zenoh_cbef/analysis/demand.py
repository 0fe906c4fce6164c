"""What a run asks of its processes by the number of agents: links, messages and bytes of a step, memory and open files.

The one place of these formulas; docs/scale.md says how far measurements agree with them. With n agents, one of which
has d neighbours, L rounds, and h = 1 where the filter uses neighbours' ranges (otherwise 0), without smoothing:

    linked by graph    links        sent in a step            received in a step
    agent              d + 2        (d + 1) L + d h + 3       d (L + h) + 1
    target             n + 1        2 n + 1                   n
    recorder           n + 1        0                         n (L + 3) + 1
    through a router
    agent              1            L + 2                     d (L + h) + 1
    target             1            n + 1                     n
    recorder           1            0                         n (L + 3) + 1
    router             n + 2        what all receive          what all send
"""

from __future__ import annotations

from dataclasses import dataclass

from zenoh_cbef.analysis.traffic import beacon_bytes, other_bytes, range_bytes, round_bytes, truth_bytes
from zenoh_cbef.machine import files_needed, memory_needed
from zenoh_cbef.protocol.short import SILENT_BYTES
from zenoh_cbef.scenario.plan import Plan

ENVELOPE = 12
"""Bytes that Zenoh adds to a message: key, number, length and options; measured (docs/scale.md)."""


@dataclass(frozen=True)
class Load:
    """What one process carries. Messages and bytes are of a step and count once for each link that they cross."""

    links: float
    sent: float
    received: float
    bytes_sent: float
    bytes_received: float

    @property
    def files(self) -> int:
        """Open files."""
        return files_needed(round(self.links))

    @property
    def memory(self) -> float:
        """Memory that it shares with no other process, bytes."""
        return memory_needed(self.links)


@dataclass(frozen=True)
class Demand:
    """A run's processes. agent: the mean of all; busiest: the agent with the most neighbours. router: None without.

    link: bit/s between two neighbours, either way, with a step in each dt; most of a radio's or a modem's budget.
    """

    agent: Load
    busiest: Load
    target: Load
    recorder: Load
    link: float
    router: Load | None = None


class _Sizes:
    """Bytes of the messages of a step, with Zenoh's envelope."""

    def __init__(self, plan: Plan, other: float | None) -> None:
        other = other_bytes(plan) if other is None else other
        self.beacon, self.truth = beacon_bytes(plan) + ENVELOPE, truth_bytes(plan) + ENVELOPE
        self.range, self.round = range_bytes(plan) + ENVELOPE, round_bytes(plan) + ENVELOPE
        self.estimate = other - range_bytes(plan) + ENVELOPE


def demand(plan: Plan, *, other: float | None = None, routed: bool = False) -> Demand:
    """The loads of a run with one recorder, linked by its graph, or routed: all processes are clients of one router.

    other: what `other_bytes` gives, of a caller that has it.
    """
    size, degrees, agents = _Sizes(plan, other), plan.neighbours.degree, plan.scenario.count
    mean, busiest = (_agent(plan, size, float(degree), routed=routed) for degree in (degrees.mean(), degrees.max()))
    links, copies = (1, 1) if routed else (agents + 1, 2)
    beacons = copies * agents * size.beacon + size.truth
    target = Load(links, copies * agents + 1, agents, beacons, agents * size.estimate)
    heard = agents * (plan.rounds + 3) + 1
    every = agents * (plan.rounds * size.round + size.range + size.estimate + size.beacon) + size.truth
    recorder = Load(links, 0, heard, 0, every)
    link = 8.0 * link_bytes(plan) / plan.scenario.dt
    if not routed:
        return Demand(mean, busiest, target, recorder, link)
    out = agents * mean.received + target.received + heard
    out_bytes = agents * mean.bytes_received + target.bytes_received + every
    return Demand(mean, busiest, target, recorder, link, Load(agents + 2, out, heard, out_bytes, every))


def link_bytes(plan: Plan, *, rounds: int | None = None, silent: float = 0.0) -> float:
    """Bytes from one neighbour to another in a step. rounds: None for the plan's. silent: in how many of them."""
    rounds = plan.rounds if rounds is None else rounds
    told = rounds * (round_bytes(plan) + ENVELOPE) - silent * (round_bytes(plan) - SILENT_BYTES)
    return told + plan.sharing.uses_neighbour_ranges * (range_bytes(plan) + ENVELOPE)


def _agent(plan: Plan, size: _Sizes, degree: float, *, routed: bool) -> Load:
    """An agent with so many neighbours; its recorder hears everything, the target its estimates."""
    rounds, ranges = degree * plan.rounds, degree * int(plan.sharing.uses_neighbour_ranges)
    received = rounds + ranges + 1, rounds * size.round + ranges * size.range + size.beacon
    if routed:
        sent = plan.rounds + 2.0, plan.rounds * size.round + size.range + size.estimate
        return Load(1, sent[0], received[0], sent[1], received[1])
    rounds, ranges = rounds + plan.rounds, ranges + 1
    sent = rounds + ranges + 2, rounds * size.round + ranges * size.range + 2 * size.estimate
    return Load(degree + 2, sent[0], received[0], sent[1], received[1])
