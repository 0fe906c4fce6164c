"""Undirected communication graphs and neighbour lists."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats, Ids, Ints
from zenoh_cbef.errors import UserError
from zenoh_cbef.streams import Keys, stream, uniform

Edges = Ints

KINDS = ("erdos-renyi", "ring", "path", "star", "grid", "complete", "geometric")
_MOST_DRAWS = 1000
_HOPELESS = 14.0
"""So many agents without an edge, on average: then not one graph in a million is connected."""
_AT_ONCE = 64


@dataclass(frozen=True)
class Neighbours:
    """Neighbour lists of a batch, ascending, padded with the agent itself.

    index: (n, m), rows of the batch. present: (n, m), False where padded. An agent process holds one row whose
    index is not a row of its own batch of one but the neighbour's id.
    """

    index: NDArray[np.intp]
    present: Bools

    @property
    def degree(self) -> NDArray[np.intp]:
        """Number of neighbours, (n,)."""
        return np.asarray(self.present.sum(axis=1), dtype=np.intp)

    @property
    def ids(self) -> list[list[int]]:
        """Every row's neighbours."""
        return [index[there].tolist() for index, there in zip(self.index, self.present, strict=True)]

    @property
    def links(self) -> list[slice]:
        """Where the links to every row are among all, which are in the order of rows and, in each, of neighbours."""
        return [slice(start, end) for start, end in pairwise([0, *np.cumsum(self.degree).tolist()])]

    def row(self, agent: int) -> Neighbours:
        """One agent's neighbours, without padding."""
        present = self.present[agent]
        return Neighbours(self.index[agent, present][None], np.ones((1, int(present.sum())), dtype=bool))


def neighbours(count: int, edges: Edges) -> Neighbours:
    """Neighbour lists of an undirected graph of `count` agents with edges (m, 2)."""
    lists: list[list[int]] = [[] for _ in range(count)]
    for first, second in edges.tolist():
        lists[first].append(second)
        lists[second].append(first)
    width = max((len(one) for one in lists), default=0)
    index = np.repeat(np.arange(count, dtype=np.intp)[:, None], width, axis=1)
    present = np.zeros((count, width), dtype=bool)
    for agent, one in enumerate(lists):
        index[agent, : len(one)] = sorted(one)
        present[agent, : len(one)] = True
    return Neighbours(index, present)


def stack(blocks: list[Neighbours]) -> Neighbours:
    """One disconnected graph of many: the rows of each block follow those of the one before."""
    width = max(block.index.shape[1] for block in blocks)
    indices, presents, start = [], [], 0
    for block in blocks:
        count, degree = block.index.shape
        own = np.repeat(np.arange(count, dtype=np.intp)[:, None], width - degree, axis=1)
        indices.append(np.concatenate([block.index, own], axis=1) + start)
        presents.append(np.pad(block.present, ((0, 0), (0, width - degree))))
        start += count
    return Neighbours(np.concatenate(indices), np.concatenate(presents))


def components(count: int, edges: Edges) -> list[list[int]]:
    """The connected components, each ascending, by least member."""
    label = list(range(count))

    def root(agent: int) -> int:
        while label[agent] != agent:
            label[agent] = label[label[agent]]
            agent = label[agent]
        return agent

    for first, second in edges.tolist():
        low, high = sorted((root(first), root(second)))
        label[high] = low
    groups: dict[int, list[int]] = {}
    for agent in range(count):
        groups.setdefault(root(agent), []).append(agent)
    return list(groups.values())


def _grid(count: int) -> list[tuple[int, int]]:
    # The rows are as long as a near-square allows; the last row may be shorter.
    columns = isqrt(count - 1) + 1 if count > 1 else 1
    right = [(agent, agent + 1) for agent in range(count - 1) if (agent + 1) % columns]
    return right + [(agent, agent + columns) for agent in range(count - columns)]


@lru_cache(maxsize=256)
def _erdos_renyi(count: int, probability: float, seed: int) -> Edges:
    first, second = pairs = np.triu_indices(count, 1)
    key = stream(seed, "graph", first, second)
    # The number of agents without an edge is about Poisson distributed (Erdos, Renyi, Publ. Math. Debrecen 6, 1959).
    lonely = count * (1.0 - probability) ** (count - 1)
    for draw in range(_MOST_DRAWS if lonely < _HOPELESS else 0):
        chosen = _chosen(key, pairs, probability, draw)
        edges = np.stack([first[chosen], second[chosen]], axis=1).astype(np.int64)
        if len(components(count, edges)) == 1:
            edges.flags.writeable = False  # All callers that ask for this graph get the same array.
            return edges
    raise UserError(
        f"network.probability = {probability} hardly ever joins {count} agents to one network; "
        f"raise it to about ln(n)/n = {np.log(count) / count:.2g} or above, or name another network.graph"
    )


def _chosen(key: Keys, pairs: tuple[Ids, Ids], probability: float, draw: int) -> Bools:
    """Which pairs are joined in a draw; it stops, with too few pairs, at the first agent without any edge."""
    first, second = pairs
    count = 1 + int(second.max(initial=0))
    chosen, joined = np.zeros(len(key), dtype=bool), np.zeros(count, dtype=bool)
    for agents in range(0, count, _AT_ONCE):
        block = slice(*np.searchsorted(first, [agents, agents + _AT_ONCE]))
        chosen[block] = uniform(key[block], draw) < probability
        joined[first[block][chosen[block]]] = joined[second[block][chosen[block]]] = True
        if not joined[agents : agents + _AT_ONCE].all():
            break
    return chosen


def _geometric(positions: Floats, radius: float) -> Edges:
    first, second = np.triu_indices(len(positions), 1)
    near = np.sum((positions[first] - positions[second]) ** 2, axis=1) <= radius * radius
    return np.stack([first[near], second[near]], axis=1).astype(np.int64)


def make_edges(kind: str, positions: Floats, *, seed: int, probability: float, radius: float) -> Edges:
    """The edges (m, 2) of a graph over agents at positions (n, 3), lower end first, sorted.

    erdos-renyi is drawn again until connected; geometric joins agents at most `radius` metres apart.
    """
    count = len(positions)
    if kind == "erdos-renyi":
        return _erdos_renyi(count, probability, seed)
    if kind == "geometric":
        return _geometric(positions, radius)
    every = range(count)
    pairs = {
        "ring": [(agent, (agent + 1) % count) for agent in every] if count > 2 else [(0, 1)][: count - 1],
        "path": [(agent, agent + 1) for agent in range(count - 1)],
        "star": [(0, agent) for agent in range(1, count)],
        "grid": _grid(count),
        "complete": [(first, second) for first in every for second in range(first + 1, count)],
    }[kind]
    return canonical_edges(pairs)


def canonical_edges(pairs: list[tuple[int, int]]) -> Edges:
    """Edges with the lower end first, each once, sorted; (m, 2)."""
    return np.array(sorted({(min(pair), max(pair)) for pair in pairs}), dtype=np.int64).reshape(-1, 2)
