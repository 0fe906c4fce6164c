"""The fate of every message under a scenario's faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.faults.base import Bools, Fault, Floats, Ids, MessageFault, Messages, Seeds


@dataclass(frozen=True)
class Fate:
    """What becomes of messages, arrays (e,); a message is at most one of absent, lost, late and corrupted.

    absent: never sent, or nobody is there to receive it. lost: never arrives. late: arrives when its round is over.
    corrupted: arrives in time, but damaged, and is rejected.
    duplicated: is used, and arrives once more. delay: of those that arrive, beyond the lag, s.
    """

    lost: Bools
    late: Bools
    corrupted: Bools
    duplicated: Bools
    delay: Floats
    absent: Bools

    @property
    def due(self) -> Bools:
        """Which messages arrive intact within their own round."""
        return ~(self.absent | self.lost | self.late | self.corrupted)


class Fates:
    """Fates of the messages on directed links, the same on any host and in any batch.

    faults: all of a scenario, of which those of messages count. seed, source, destination: (e,). dt: s. rounds: L.
    ranges: whether neighbours' ranges are sent before the rounds. realtime: a delay is real time, so that the
    receiver finds out whether the message is late; otherwise a message that is delayed at all misses its round.
    lag: how many steps after its own a message is used; it may be on its way for so long.
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
        ranges: bool = True,
        realtime: bool = False,
        lag: int = 0,
    ) -> None:
        self._faults = [
            (index, fault, chosen)
            for index, fault in enumerate(faults)
            if isinstance(fault, MessageFault) and (chosen := fault.selects(source, destination)).any()
        ]
        self._seed, self._source, self._destination = seed, source, destination
        self._dt, self._per_step, self._ranges = dt, max(1, rounds + ranges), ranges
        self._realtime, self._spare = realtime, lag * dt

    def of(self, step: int, round_: int) -> Fate:
        """What becomes of the messages sent in one round of a step (round 0: the ranges)."""
        links = self._source.shape
        flags = {
            name: np.zeros(links, dtype=bool) for name in ("lost", "overtaken", "corrupted", "duplicated", "absent")
        }
        delay = np.zeros(links)
        messages = Messages(
            self._seed, self._source, self._destination, step, round_, self._dt, self._per_step, self._ranges
        )
        for index, fault, chosen in self._faults:
            if not fault.active(step * self._dt):
                continue
            effect = fault.effect(messages, index)
            for name, before in flags.items():
                struck = getattr(effect, name)
                if struck is not None:
                    np.logical_or(before, chosen & struck, out=before)
            if effect.delay is not None:
                delay += np.where(chosen, effect.delay, 0.0)
        absent = flags["absent"]
        lost, overtaken = flags["lost"] & ~absent, flags["overtaken"] & (self._spare == 0.0)
        delay = np.maximum(delay - self._spare, 0.0)
        late = ~(lost | absent) & (overtaken if self._realtime else overtaken | (delay > 0.0))
        corrupted = flags["corrupted"] & ~(absent | lost | late)
        duplicated = flags["duplicated"] & ~(absent | lost | late | corrupted)
        return Fate(lost, late, corrupted, duplicated, delay, absent)

    def reaches(self, step: int) -> Bools:
        """Over which links (e,) somebody who keeps asking is answered in a step: those that nothing cuts."""
        open_ = np.ones(self._source.shape, dtype=bool)
        for _, fault, chosen in self._faults:
            if fault.cuts and fault.active(step * self._dt):
                open_ &= ~chosen
        return open_

    @property
    def quiet(self) -> bool:
        """Whether no fault ever touches these links."""
        return not self._faults
