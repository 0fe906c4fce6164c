"""The links of a batch in the order in which what comes over them is added up fastest."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.graph import Neighbours


class Links:
    """The directed links (e,) to the rows of a batch: first those from each row's first neighbour, then the second.

    Rows are taken by falling degree, so the links from k-th neighbours lead to the first rows of that order: no link
    that does not exist is looked at, and each sum is of whole blocks of memory.

    order: (n,), the rows by falling degree. source: (e,), from which row each link comes. blocks: of the links from
    first neighbours, from second ones, and so on.
    """

    def __init__(self, neighbours: Neighbours) -> None:
        degree, width = neighbours.degree, neighbours.index.shape[1]
        self.order = np.argsort(-degree, kind="stable")
        self._back = np.argsort(self.order)
        ends = np.cumsum([0, *(int(np.count_nonzero(degree > one)) for one in range(width))]).tolist()
        self.blocks = [slice(begin, end) for begin, end in pairwise(ends)]
        each = [self.order[: block.stop - block.start] * width + one for one, block in enumerate(self.blocks)]
        self._places = np.concatenate([*each, self.order[:0]])
        self.source: NDArray[np.intp] = neighbours.index.ravel().take(self._places)

    def of(self, values: Floats) -> Floats:
        """What belongs to the links, (e,), of values by row and neighbour, (n, m)."""
        return values.ravel().take(self._places)

    def missed(self, delivered: Bools | None) -> NDArray[np.intp]:
        """The links over which nothing came, of what was delivered (n, m), None for all."""
        if delivered is None:
            return self._places[:0]
        return np.flatnonzero(~delivered.ravel().take(self._places))

    def summed(self, values: Floats) -> Floats:
        """Sums (n, d) of values (e, d) over the links to each row, in ascending order of neighbours, from 0.0."""
        total = np.zeros((len(self.order), values.shape[1]))
        for block in self.blocks:
            part = values[block]
            total[: len(part)] += part
        return total.take(self._back, axis=0)
