"""Averaging in which an agent keeps silent while its neighbours know well enough what it would send."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.consensus import Average
from zenoh_cbef.tracking.linalg import sound_rows
from zenoh_cbef.tracking.payloads import InformationPayloads


@dataclass
class Triggered(Average):
    """Averaging of information with event-triggered messages (Dimarogonas, Frazzoli, Johansson, IEEE TAC 57(5), 2012).

    In the first round of a step every agent sends. Then, with y_i its value and q_i what it sent last, it keeps silent
    in a round while q_i is near y_i, and its neighbours take q_i again:

        (V_y - O_y x)^T O_q^-1 (V_y - O_y x) + |C^-1 O_y C^-T - I|^2 <= trigger^2      x = O_q^-1 V_q, O_q = C C^T

    in every block of information, and no other number is off by more than trigger max(1, |q|). Both ends of a link use
    the same q, as with rounded messages, so the network's sum is kept, and what an agent has not told it keeps itself.

    A silent agent's message is NaN. A receiver then takes the last message of this step that reached it; where none
    did, its own value stands in, as for any message that does not come.

    trigger: above 0, about how many standard deviations of what an agent shares. blocks: see Sharing. mistakes: whether
    numbers of a first fix that stand where a block does pass for information, as before `filter.defaults = 14`.
    """

    trigger: float
    blocks: tuple[int, ...]
    mistakes: bool = False

    def start(self, payload: Floats) -> Floats:
        """All send their payloads."""
        self.silent = np.zeros(len(payload))
        self._quiet = np.zeros(len(payload), dtype=bool)
        self._known = np.zeros(self.weights.shape, dtype=bool)
        return super().start(payload)

    def mix(self, received: Floats, delivered: Bools | None) -> Floats:
        """One round, with what silent neighbours said before; returns NaN for agents that are silent in the next."""
        self.silent += self._quiet
        if not self._known.any():
            self._heard = np.zeros_like(received)
        arrived = np.ones_like(self._known) if delivered is None else delivered
        speaks = arrived & ~np.isnan(received[:, :, 0])
        self._heard[speaks] = received[speaks]
        self._known |= speaks
        before, _ = self._told, super().mix(self._heard, arrived & self._known)
        self._quiet = self._near(self._value, before)
        quiet = self._quiet[:, None]
        self._told = np.where(quiet, before, self._told)
        return np.where(quiet, np.nan, self._told)

    def _near(self, value: Floats, said: Floats) -> Bools:
        """Which values (n, d) are near enough to what was said of them (n, d)."""
        near, start = np.ones(len(value), dtype=bool), 0
        for size in self.blocks:
            block = InformationPayloads(size, size)
            mine = slice(start, start + block.length)
            # Of what is no information on the whole state, as in the first steps, nothing can be near.
            matrices = block.claims(said[:, mine])[1]
            sound = np.linalg.det(matrices) > 0.0 if self.mistakes else sound_rows(matrices)
            known = np.where(sound[:, None], said[:, mine], block.unit)
            near &= sound & (block.distance(known, value[:, None, mine])[:, 0] <= self.trigger**2)
            start = mine.stop
        others = np.abs(value[:, start:] - said[:, start:]) <= self.trigger * np.maximum(1.0, np.abs(said[:, start:]))
        return near & others.all(axis=1)
