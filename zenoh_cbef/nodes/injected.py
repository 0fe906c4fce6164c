"""What the scenario's faults did to the messages that an agent's neighbours sent, for its estimates."""

from __future__ import annotations

from typing import Any

import numpy as np

from zenoh_cbef.faults import Fate

_IN_TIME = "."
_ABSENT = "-"
_MARKS = {"injected_lost": "x", "injected_late": ">", "corrupted": "!", "duplicated": "+"}


class Injected:
    """Counts per neighbour since the start, and a mark for every message of the present step."""

    def __init__(self, neighbours: int) -> None:
        self._counts = {name: [0] * neighbours for name in _MARKS}
        self._marks = [""] * neighbours

    def note(self, fate: Fate) -> None:
        """Take in one round's fates."""
        pairs = zip(self._marks, fate.absent.tolist(), strict=True)
        self._marks = [marks + (_ABSENT if absent else _IN_TIME) for marks, absent in pairs]
        for name in _MARKS:
            for place in np.flatnonzero(getattr(fate, name.removeprefix("injected_"))):
                self.add(name, int(place))

    def add(self, name: str, place: int) -> None:
        """Count what a fault did to the message last noted of a neighbour."""
        self._counts[name][place] += 1
        self._marks[place] = self._marks[place][:-1] + _MARKS[name]

    def take(self) -> dict[str, list[Any]]:
        """The counts, and the marks of the step that ends, where a fault did anything in it."""
        taken: dict[str, list[Any]] = {name: count.copy() for name, count in self._counts.items()}
        if any(marks.strip(_IN_TIME) for marks in self._marks):
            taken["fates"] = self._marks
        self._marks = [""] * len(self._marks)
        return taken
