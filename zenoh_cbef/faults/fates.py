"""The fate of every message under a scenario's faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ids
from zenoh_cbef.faults.answers import asking, flaw_of_array, flaw_of_effect, refuse
from zenoh_cbef.faults.base import Fault, MessageFault, Messages, Seeds
from zenoh_cbef.streams import LinkStreams

_FLAGS = ("lost", "overtaken", "corrupted", "duplicated", "absent")


@dataclass(frozen=True)
class Fate:
    """What becomes of messages, arrays (e,); a message is at most one of absent, lost, late and corrupted.

    absent: never sent, or its receiver is not there. lost: never arrives. late: arrives when its round is over.
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

    def on(self, links: slice) -> Fate:
        """The fate of the messages on some of the links."""
        return Fate(*(getattr(self, field.name)[links] for field in fields(self)))


def _selected(fault: MessageFault, source: Ids, destination: Ids) -> Bools:
    with asking(fault, "selects"):
        chosen = fault.selects(source, destination)
        refuse(flaw_of_array(chosen, "selects()", source.shape))
    return chosen


class Fates:
    """Fates of the messages on directed links, the same on any host and in any batch.

    faults: all of a scenario, of which those of messages count. seed, source, destination: (e,). dt: s. rounds: L.
    ranges: whether neighbours' ranges are sent before the rounds. realtime: a delay is real time, so that the
    receiver finds out whether the message is late; otherwise a message that is delayed at all misses its round.
    lag: how many steps after its own a message is used; it may be on its way for so long. apart: (e, K), the steps in
    which a link does not exist; None: all always do.
    quiet: whether no fault ever touches these links, and they always exist.
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
        apart: Bools | None = None,
    ) -> None:
        self._faults = [
            (index, fault, chosen)
            for index, fault in enumerate(faults)
            if isinstance(fault, MessageFault) and (chosen := _selected(fault, source, destination)).any()
        ]
        self._seed, self._source, self._destination = seed, source, destination
        self._dt, self._per_step, self._ranges = dt, max(1, rounds + ranges), ranges
        self._realtime, self._spare = realtime, lag * dt
        self._apart = apart
        self.quiet = not self._faults and apart is None
        self._streams = LinkStreams(seed, source, destination, range(not ranges, self._per_step + (not ranges)))
        # All fates without a fault share these arrays, so they are read-only.
        self._never, self._none = np.zeros(source.shape, dtype=bool), np.zeros(source.shape)
        self._never.flags.writeable = self._none.flags.writeable = False

    def of(self, step: int, round_: int) -> Fate:
        """What becomes of the messages sent in one round of a step (round 0: the ranges)."""
        messages = self._messages(step, round_)
        struck: dict[str, Bools] = {} if self._apart is None else {"absent": self._apart[:, step - 1]}
        delay = self._none
        for index, fault, chosen in self._faults:
            if not fault.active(step * self._dt):
                continue
            with asking(fault, "effect"):
                effect = fault.effect(messages, index)
                refuse(flaw_of_effect(effect, len(self._source)))
            for name in _FLAGS:
                flag = getattr(effect, name)
                if flag is not None:
                    flag = flag & chosen
                    struck[name] = struck[name] | flag if name in struck else flag
            if effect.delay is not None:
                delay = delay + np.where(chosen, effect.delay, 0.0)
        overtaken = struck.pop("overtaken", None)
        if delay is not self._none or overtaken is not None:
            delay = np.maximum(delay - self._spare, 0.0)
            after = self._never if overtaken is None or self._spare else overtaken
            struck["late"] = after if self._realtime else after | (delay > 0.0)
        return Fate(delay=delay, **self._told_apart(struck))

    def _messages(self, step: int, round_: int) -> Messages:
        return Messages(
            seed=self._seed,
            source=self._source,
            destination=self._destination,
            step=step,
            round=round_,
            dt=self._dt,
            per_step=self._per_step,
            ranges=self._ranges,
            streams=self._streams,
        )

    def _told_apart(self, struck: dict[str, Bools]) -> dict[str, Bools]:
        """Of several faults of one message the first in this order counts."""
        apart, before = {}, None
        for name in ("absent", "lost", "late", "corrupted", "duplicated"):
            flag = struck.get(name)
            if flag is None:
                apart[name] = self._never
                continue
            apart[name] = flag if before is None else flag & ~before
            before = flag if before is None else before | flag
        return apart

    def reaches(self, step: int) -> Bools:
        """Over which links (e,) an agent that keeps asking gets an answer in a step: those that no fault cuts."""
        open_ = np.ones(self._source.shape, dtype=bool) if self._apart is None else ~self._apart[:, step - 1]
        for _, fault, chosen in self._faults:
            if fault.cuts and fault.active(step * self._dt):
                open_ &= ~chosen
        return open_
