"""What a recorder sees of a run while it goes by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.protocol.keys import agent_of
from zenoh_cbef.protocol.messages import BadMessage, decode


@dataclass
class Status:
    """What the recorder sees of a run.

    began: whether any estimate was seen. step: what all estimates have reached; error: the network's position error
    (m) there. messages: recorded. lost, late: on links, as their receivers counted. missing: gaps in the sequence
    numbers of what was recorded. behind: how often the recorder fell behind. dropped: messages that could not be
    written, and failure: why not.
    """

    run: str
    log: str
    steps: int
    began: bool = False
    step: int = 0
    error: float | None = None
    messages: int = 0
    lost: int = 0
    late: int = 0
    missing: int = 0
    behind: int = 0
    dropped: int = 0
    failure: str = ""
    state: str = "recording"


class Overview:
    """Keeps a Status up to date from the messages that go by."""

    def __init__(self, status: Status, present: Callable[[], int]) -> None:
        self.status = status
        self._present = present
        self._expected = 1
        self._truth: dict[int, list[float]] = {}
        self._errors: dict[int, list[float]] = {}
        self._links: dict[int, tuple[int, int]] = {}

    def see(self, kind: str, key: str, data: bytes) -> None:
        """Take one truth or estimate message into account."""
        try:
            message = decode(kind, data, run=self.status.run)
        except BadMessage:
            return
        step = message["k"]
        if kind == "truth":
            self._truth[step] = message["state"]
            return
        self.status.began = True
        self._links[agent_of(key)] = (sum(message["lost"]), sum(message["late"]))
        truth = self._truth.get(step)
        if truth is None:
            return
        errors = self._errors.setdefault(step, [])
        errors.append(sum((a - b) ** 2 for a, b in zip(message["state"][:3], truth[:3], strict=True)))
        # At the end everybody has left before their last words are read.
        self._expected = self._present() or self._expected
        if len(errors) >= self._expected:
            self.status.step = step
            self.status.error = float(np.sqrt(np.mean(errors)))
            self.status.lost = sum(lost for lost, _ in self._links.values())
            self.status.late = sum(late for _, late in self._links.values())
            for old in [known for known in self._truth if known <= step]:
                self._truth.pop(old)
                self._errors.pop(old, None)
