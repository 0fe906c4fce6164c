"""The messages of a run as arrays that grow with it: nothing else of a message is kept."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.protocol.round_codec import Rounds
from zenoh_cbef.tracking.diagnostics import NAMES

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_MATRIX = 8 * 36
_FIRST_CAPACITY = 64


class Table:
    """Numbers by row and step, the first that are put in each place; NaN where there are none. last: highest step."""

    def __init__(self, rows: int, width: int, limit: int) -> None:
        self.last = 0
        self._limit = limit
        self._values = np.full((rows, _FIRST_CAPACITY, width), np.nan)
        self._seen = np.zeros((rows, _FIRST_CAPACITY), dtype=bool)

    def put(self, row: int, steps: Sequence[int], values: Floats) -> Bools:
        """Put numbers (m, width) for steps 1 to the limit; says which of them were put (m,)."""
        step = np.array([one if one <= self._limit else 0 for one in steps])
        places, first = np.unique(step, return_index=True)
        highest = int(places[-1])
        if highest > self._values.shape[1]:
            self._grow(highest)
        new = np.zeros(len(step), dtype=bool)
        new[first] = (places > 0) & ~self._seen[row, places - 1]
        self._values[row, step[new] - 1] = values[new]
        self._seen[row, step[new] - 1] = True
        self.last = max(self.last, int(step[new].max(initial=0)))
        return new

    def seen(self, steps: int) -> Bools:
        """Whether numbers were put, (rows, steps)."""
        if steps > self._seen.shape[1]:
            self._grow(steps)
        return self._seen[:, :steps]

    def upto(self, steps: int) -> Floats:
        """The numbers of steps 1 to `steps`, (rows, steps, width)."""
        if steps > self._values.shape[1]:
            self._grow(steps)
        return self._values[:, :steps]

    def _grow(self, step: int) -> None:
        rows, capacity, width = self._values.shape
        added = min(max(2 * capacity, step), self._limit) - capacity
        self._values = np.concatenate([self._values, np.full((rows, added, width), np.nan)], axis=1)
        self._seen = np.concatenate([self._seen, np.zeros((rows, added), dtype=bool)], axis=1)


class Columns:
    """What a trace is made of, for n agents and at most `limit` steps.

    truth: 6 numbers. beacons: emitted, arrived. positions: 3. estimates: state (6), and the
    diagnostics. covariances: 36. faults: the last list of injected ones, JSON, or empty.
    lives: of each agent, the last estimate of each of its lives, from one start to the next. latency:
    sum and number of the latencies by (source, destination).
    """

    def __init__(self, count: int, limit: int) -> None:
        self.truth = Table(1, 6, limit)
        self.beacons, self.positions = Table(count, 2, limit), Table(count, 3, limit)
        self.estimates, self.covariances = Table(count, 6 + len(NAMES), limit), Table(count, 36, limit)
        self.events: list[dict[str, Any]] = []
        self.faults = ""
        self.lives: dict[int, list[dict[str, Any]]] = {}
        self.latency: dict[tuple[int, int], tuple[float, int]] = {}

    def take(self, kind: str, agent: int, messages: list[dict[str, Any]]) -> None:
        """Keep the numbers of messages."""
        steps = [message.get("k", 0) for message in messages]
        if kind == "estimate":
            self._take_estimates(agent, steps, messages)
        elif kind == "beacon":
            self._take_beacons(agent, [message for message in messages if "signal" not in message])
        elif kind == "range":
            self.positions.put(agent, steps, _floats([message["position"] for message in messages]))
        elif kind == "truth":
            self.truth.put(0, steps, _floats([message["state"] for message in messages]))
        elif kind == "faults":
            self.faults = messages[-1]["tables"]
        elif kind == "event":
            self.events += messages

    def take_rounds(self, agent: int, rounds: Rounds) -> None:
        """Payloads are no part of a trace."""

    def _take_beacons(self, agent: int, messages: list[dict[str, Any]]) -> None:
        if messages:
            times = _floats([[message["emitted"], message["arrived"]] for message in messages])
            self.beacons.put(agent, [message["k"] for message in messages], times)

    def _take_estimates(self, agent: int, steps: list[int], messages: list[dict[str, Any]]) -> None:
        rows = [[*message["state"], *map(message.get, NAMES)] for message in messages]
        new = self.estimates.put(agent, steps, _floats(rows))
        messages = [message for message, is_new in zip(messages, new.tolist(), strict=True) if is_new]
        matrices = [message for message in messages if message["covariance"] and len(message["covariance"]) == _MATRIX]
        if matrices:
            joined = np.frombuffer(b"".join([message["covariance"] for message in matrices]), "<f8")
            self.covariances.put(agent, [message["k"] for message in matrices], joined.reshape(-1, 36))
        for message in messages:
            lives = self.lives.setdefault(agent, [message])
            if message["seq"] < lives[-1]["seq"]:
                lives.append(message)  # It was started again, and counts anew.
            lives[-1] = message
            for source, delay in zip(message["neighbours"], message["latency"], strict=False):
                if delay is not None:
                    total, number = self.latency.get((source, agent), (0.0, 0))
                    self.latency[source, agent] = total + delay, number + 1


def _floats(rows: list[list[float | None]]) -> Floats:
    """Numbers as an array, NaN for nil."""
    return np.array(rows, dtype=np.float64)
