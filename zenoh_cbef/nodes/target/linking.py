"""Which processes of a run link to each other."""

from __future__ import annotations

from collections.abc import Callable

from zenoh_cbef.protocol.keys import agent_named
from zenoh_cbef.protocol.shares import records
from zenoh_cbef.tracking.graph import Edges


def linked_by(edges: Edges) -> Callable[[str, str], bool]:
    """A test of two processes' names: whether they are neighbours in the graph (m, 2), or an agent and its recorder."""
    pairs = {frozenset(pair) for pair in edges.tolist()}

    def linked(name: str, other: str) -> bool:
        one, two = agent_named(name), agent_named(other)
        if one is not None and two is not None:
            return frozenset((one, two)) in pairs
        if one is None:
            return two is not None and records(name, two)
        return records(other, one)

    return linked
