"""Which neighbours an agent links to, step by step."""

from __future__ import annotations

from collections.abc import Callable, Collection
from math import ceil

import numpy as np

from zenoh_cbef.scenario.network import by_radio, in_range_of
from zenoh_cbef.scenario.plan import Plan

_SECONDS, _STEPS = 3.0, 20
"""How long before agents come into range they link, and how long after they have left it they keep the link: in steps,
so many at least."""


class Vicinity:
    """The neighbours that an agent links to: all, or with the graph `radio` those that are in range, now or soon.

    Agents move along paths that the scenario gives, so each knows beforehand which others come into range. follows:
    whether links can be made and ended during the run. step: at which the agent is. arriving: which of all agents come
    into range in it, (n,), None where links do not change. on_change: called when it comes to a step at which other
    neighbours are to be linked.
    """

    def __init__(self, plan: Plan, agent: int, ids: Collection[int], *, follows: bool) -> None:
        self._ids = frozenset(ids)
        moves = follows and by_radio(plan.scenario)
        self._near = in_range_of(plan.scenario, agent) if moves else None
        self._span = max(_STEPS, ceil(_SECONDS / plan.scenario.dt))
        self.step, self.arriving = 0, None if self._near is None else self._near[:, 0]
        self.on_change: Callable[[], None] = lambda: None

    def come(self, step: int) -> None:
        """The agent begins a step."""
        former, self.step = self.step, step
        if self._near is not None:
            last = self._near.shape[1]
            self.arriving = self._near[:, min(step, last) - 1] & ~self._near[:, max(step - 2, 0)]
            if self._between(former, former + self._span) != self.wanted():
                self.on_change()

    def wanted(self) -> frozenset[int]:
        """The agents to link to."""
        return self._between(self.step, self.step + self._span)

    def kept(self) -> frozenset[int]:
        """The agents to which a link need not be ended."""
        return self._between(self.step - self._span, self.step + self._span)

    def _between(self, first: int, last: int) -> frozenset[int]:
        if self._near is None:
            return self._ids
        near = self._near[:, max(first, 1) - 1 : max(last, 1)].any(axis=1)
        return self._ids.intersection(np.flatnonzero(near).tolist())
