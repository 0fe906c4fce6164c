"""The fate of every message under a scenario's faults."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef.faults.base import Bools, Fate, Fault, Ids, LinkFault, Messages, Seeds


class Fates:
    """Fates of the messages on directed links, the same on any host and in any batch.

    faults: all of a scenario; those of links count. seed, source, destination: (e,). dt: s. rounds: L; a step has
    L + 1 slots, of which slot 0 carries ranges.
    """

    def __init__(
        self,
        faults: Sequence[Fault],
        *,
        seed: Seeds,
        source: Ids,
        destination: Ids,
        dt: float,
        rounds: int,
    ) -> None:
        self._faults = [
            (index, fault, chosen)
            for index, fault in enumerate(faults)
            if isinstance(fault, LinkFault) and (chosen := fault.selects(source, destination)).any()
        ]
        self._seed, self._source, self._destination = seed, source, destination
        self._dt = dt
        self._slot = dt / (rounds + 1)

    def of(self, step: int, round_: int) -> Fate:
        """Loss and delay (s) of the messages sent in one round of a step (round 0: the ranges)."""
        fate = Fate(np.zeros(self._source.shape, dtype=bool), np.zeros(self._source.shape))
        messages = Messages(self._seed, self._source, self._destination, step, round_)
        for index, fault, chosen in self._faults:
            if fault.active(step * self._dt):
                effect = fault.fate(messages, index)
                fate = Fate(fate.lost | (chosen & effect.lost), fate.delay + np.where(chosen, effect.delay, 0.0))
        return fate

    def due(self, step: int, round_: int) -> tuple[Bools, Bools]:
        """Which messages arrive within their own round, and which are late, (e,) each; the rest are lost.

        In lockstep a message delayed by d counts as arriving ceil(d/slot) rounds later, slot = dt/(L + 1).
        """
        fate = self.of(step, round_)
        late = ~fate.lost & (np.ceil(fate.delay / self._slot) > 0)
        return ~fate.lost & ~late, late

    @property
    def quiet(self) -> bool:
        """Whether no fault ever touches these links."""
        return not self._faults
