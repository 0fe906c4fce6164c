"""Undirected communication graphs and neighbour lists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats, Ids, Ints
from zenoh_cbef.errors import UserError
from zenoh_cbef.streams import Keys, stream, uniform
from zenoh_cbef.tracking.near import pairs_within

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
    both = np.concatenate([edges, edges[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    degree = np.bincount(both[:, 0], minlength=count)
    width = int(degree.max(initial=0))
    index = np.repeat(np.arange(count, dtype=np.intp)[:, None], width, axis=1)
    present = np.arange(width) < degree[:, None]
    index[present] = both[:, 1]
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


def directed(edges: Edges) -> Edges:
    """Both directions of each edge (m, 2), (2 m, 2): source and destination, by destination, then source."""
    both = np.concatenate([edges, edges[:, ::-1]])
    return both[np.lexsort(both.T)]


def components(count: int, edges: Edges) -> list[list[int]]:
    """The connected components, each ascending, by least member."""
    label = np.arange(count)
    first, second = edges.T
    while True:
        # Every component takes the least number among its neighbours', then each agent that of its own.
        low, following = np.minimum(label[first], label[second]), label.copy()
        np.minimum.at(following, label[first], low)
        np.minimum.at(following, label[second], low)
        while not np.array_equal(shorter := following[following], following):
            following = shorter
        if np.array_equal(following, label):
            break
        label = following
    order = np.argsort(label, kind="stable")
    ends = np.flatnonzero(np.diff(label[order])) + 1
    return [group.tolist() for group in np.split(order, ends)] if count else []


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


def make_edges(kind: str, positions: Floats, *, seed: int, probability: float, radius: float) -> Edges:
    """The edges (m, 2) of a graph over agents at positions (n, 3), lower end first, sorted.

    erdos-renyi is drawn again until connected; geometric joins agents at most `radius` metres apart.
    """
    count = len(positions)
    if kind == "erdos-renyi":
        return _erdos_renyi(count, probability, seed)
    if kind == "geometric":
        return pairs_within(positions, radius)
    return _REGULAR[kind](count)


def canonical_edges(pairs: Sequence[tuple[int, int]] | Edges) -> Edges:
    """Edges with the lower end first, each once, sorted; (m, 2)."""
    ends = np.sort(np.asarray(pairs, dtype=np.int64).reshape(-1, 2), axis=1)
    return np.asarray(np.unique(ends, axis=0), dtype=np.int64)


def _ring(count: int) -> Edges:
    agents = np.arange(count if count > 2 else count - 1)
    return canonical_edges(np.stack([agents, (agents + 1) % count], axis=1))


def _path(count: int) -> Edges:
    agents = np.arange(count - 1)
    return np.stack([agents, agents + 1], axis=1)


def _star(count: int) -> Edges:
    others = np.arange(1, count)
    return np.stack([np.zeros_like(others), others], axis=1)


def _grid(count: int) -> Edges:
    # The rows are as long as a near-square allows; the last row may be shorter.
    columns = isqrt(count - 1) + 1 if count > 1 else 1
    path = _path(count)
    below = np.arange(max(0, count - columns))
    return canonical_edges(np.concatenate([path[path[:, 1] % columns > 0], np.stack([below, below + columns], axis=1)]))


def _complete(count: int) -> Edges:
    return np.stack(np.triu_indices(count, 1), axis=1).astype(np.int64)


_REGULAR = {"ring": _ring, "path": _path, "star": _star, "grid": _grid, "complete": _complete}
