"""Which processes of a run link to each other."""

from __future__ import annotations

from collections.abc import Callable

from zenoh_cbef.protocol.keys import agent_named
from zenoh_cbef.tracking.graph import Edges


def linked_by(edges: Edges) -> Callable[[str, str], bool]:
    """A test of two processes' names: whether these are neighbours in the graph (m, 2), or an agent and a recorder."""
    pairs = {frozenset(pair) for pair in edges.tolist()}

    def linked(name: str, other: str) -> bool:
        agents = {agent_named(name), agent_named(other)}
        return len(agents) == 2 if None in agents else agents in pairs

    return linked
