"""What a process of an exchange of rounds needs; it imports little, as dozens of them start at once."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Part:
    """One process of an exchange. neighbours: ascending. endpoints: where each process listens, by id."""

    me: int
    neighbours: list[int]
    endpoints: list[str]


@dataclass(frozen=True)
class Outcome:
    """What a process tells at its end. rate: its rounds per second. values: what it has averaged, if it does that."""

    me: int
    rate: float
    values: list[float]

    def tell(self) -> None:
        """Hand it over, in one write: several processes may have the same output."""
        sys.stdout.write(json.dumps(asdict(self)) + "\n")
        sys.stdout.flush()


def timed(rounds: int, turn: Callable[[int], None]) -> float:
    """Take part in so many rounds, numbered from 0; returns rounds per second from a tenth of them to the end."""
    warm = rounds // 10
    for round_ in range(warm):
        turn(round_)
    began = time.perf_counter()
    for round_ in range(warm, rounds):
        turn(round_)
    return (rounds - warm) / (time.perf_counter() - began)


def end_with_parent() -> None:
    """In a child: end when the parent does, however it ended."""

    def follow() -> None:
        while os.read(0, 4096):
            pass
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def end_with(pid: int) -> None:
    """In a process that a launcher has started, with pipes of its own: end when the benchmark does, a second later."""

    def follow() -> None:
        while True:
            try:
                os.kill(pid, 0)
            except ProcessLookupError:
                os._exit(1)
            time.sleep(1.0)

    threading.Thread(target=follow, daemon=True).start()


def part_of(told: str, place: Callable[[], int]) -> Part:
    """The part that a command line tells, or of a list of all parts the one at a place."""
    found = json.loads(told)
    return Part(**(found[place()] if isinstance(found, list) else found))


def as_text(parts: Part | Sequence[Part]) -> str:
    """A part, or all of them, for a command line."""
    return json.dumps(asdict(parts) if isinstance(parts, Part) else [asdict(one) for one in parts])
