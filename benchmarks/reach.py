"""What ranges reach an agent at all: a centralised filter of more of them is a limit that no network can come to."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from zenoh_cbef.analysis.faulted import honest_agents
from zenoh_cbef.arrays import Bools
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking import graph


@dataclass(frozen=True)
class Reach:
    """Honest agents that are never away and hear the same; the run with no other ranges than those that reach them."""

    agents: list[int]
    trace: Trace


def groups(trace: Trace, there: Bools) -> list[list[int]]:
    """The groups of those of the agents (n,) that reach each other without one that is not among them."""
    edges = trace.edges[there[trace.edges].all(axis=1)]
    return [each for each in graph.components(len(there), edges) if there[each].all()]


def reaches(trace: Trace) -> Iterator[Reach]:
    """All groups of a run; one of all agents where none lies, none is away, and the graph holds together."""
    honest, absences = honest_agents(trace.scenario), trace.plan.absences
    absent = [(first, last, absences.at(first)) for first, last in absences.stretches()]
    stays = honest.copy()
    heard = np.zeros((len(honest), *trace.ranges.shape), dtype=bool)
    for first, last, away in [(1, trace.ranges.shape[1], ~honest), *absent]:
        heard[:, :, first - 1 : last] = False
        for group in groups(trace, honest & ~away):
            heard[np.ix_(group, group, range(first - 1, last))] = True
        stays &= ~away
    left = np.flatnonzero(stays if stays.any() else honest).tolist()
    while left:
        alike = [agent for agent in left if np.array_equal(heard[agent], heard[left[0]])]
        yield Reach(alike, replace(trace, ranges=np.where(heard[left[0]], trace.ranges, np.nan)))
        left = [agent for agent in left if agent not in alike]
