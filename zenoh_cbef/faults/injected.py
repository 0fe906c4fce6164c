"""What the scenario's faults did to the messages on some links, as an agent's estimates report it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from zenoh_cbef.faults.fates import Fate

FATES: Final = "fates"
"""Field of an estimate with a mark for every message of the step, where faults touched any."""

IN_TIME = "."
"""The mark of a message that no fault touched."""

ABSENT = "-"
"""The mark of a message that was not sent, or whose receiver was not there."""

_MARKS = {"injected_lost": "x", "injected_late": ">", "corrupted": "!", "duplicated": "+"}


@dataclass(frozen=True)
class Told:
    """What faults did on some links: counts since the start by name, and the marks of one step, a text for each."""

    counts: dict[str, list[int]]
    marks: list[str]

    def of(self, links: slice) -> Told:
        """The same of some of the links."""
        return Told({name: counts[links] for name, counts in self.counts.items()}, self.marks[links])

    def fields(self) -> dict[str, list[int] | list[str]]:
        """The fields of an estimate: marks only where a fault did anything in the step."""
        marks = {FATES: self.marks} if any(marks.strip(IN_TIME) for marks in self.marks) else {}
        return {**self.counts, **marks}


class Injected:
    """Counts per link since the start, and a mark for every message of the present step."""

    def __init__(self, links: int) -> None:
        self._counts = {name: [0] * links for name in _MARKS}
        self._marks = [""] * links

    def note(self, fate: Fate) -> None:
        """Take in one round's fates."""
        pairs = zip(self._marks, fate.absent.tolist(), strict=True)
        self._marks = [marks + (ABSENT if absent else IN_TIME) for marks, absent in pairs]
        for name in _MARKS:
            for place in np.flatnonzero(getattr(fate, name.removeprefix("injected_"))):
                self.add(name, int(place))

    def forget(self, links: slice) -> None:
        """Set the counts of some links to 0: their receiver was started again."""
        for counts in self._counts.values():
            counts[links] = [0] * len(counts[links])

    def add(self, name: str, place: int) -> None:
        """Count what a fault did to the message last noted of a link."""
        self._counts[name][place] += 1
        self._marks[place] = self._marks[place][:-1] + _MARKS[name]

    def take(self) -> Told:
        """The counts, and the marks of the step that ends."""
        told = Told({name: counts.copy() for name, counts in self._counts.items()}, self._marks)
        self._marks = [""] * len(self._marks)
        return told
