"""What a lockstep step costs an agent with one neighbour: Python calls, and CPU time of its main thread."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from rich.table import Table

from benchmarks.by_hand import told_by
from benchmarks.common import plain_table
from benchmarks.watched import CALLS, OURS

STEPS = 1000
_LESS, _MORE = 2, 12
"""Two runs that differ in their rounds alone tell what a round costs, and what the rest of a step."""


def watch(rounds: int, *, calls: bool, steps: int = STEPS) -> dict[str, Any]:
    """What agent 0 of two tells of a run's steps."""
    settings = ["agents.count=2", "network.graph=path", "record.required=false"]
    settings += [f"steps={steps}", f"consensus.rounds={rounds}"]
    return told_by("tracking", settings, agents=range(2), watched={CALLS: "1"} if calls else {})


@dataclass(frozen=True)
class _Counts:
    """Of a step: Python calls, those of this program's functions, these functions' files, and changes among them."""

    calls: float
    own: float
    files: int
    changes: float


def _counted(rounds: int) -> _Counts:
    told = watch(rounds, calls=True)
    steps, calls = int(told["steps"]), dict[str, int](told["calls"])
    own = {name: count for name, count in calls.items() if name.startswith(OURS)}
    files = {name.rpartition(":")[0] for name, count in own.items() if count >= steps // 2}
    return _Counts(sum(calls.values()) / steps, sum(own.values()) / steps, len(files), told["changes"] / steps)


def _microseconds(rounds: int) -> float:
    told = watch(rounds, calls=False)
    return 1e6 * float(told["seconds"]) / int(told["steps"])


def run(repeats: int) -> Iterator[Table]:
    """Timed runs of few and of many rounds in turn; medians."""
    few, many, more = _counted(_LESS), _counted(_MORE), _MORE - _LESS
    pairs = [(_microseconds(_LESS), _microseconds(_MORE)) for _ in range(repeats)]
    short, long = (statistics.median(times) for times in zip(*pairs, strict=True))
    yield plain_table(
        f"one agent, one neighbour, lockstep, medians of {repeats}",
        ["", f"a step of {_LESS} rounds", "one round more"],
        [
            ["Python calls", few.calls, (many.calls - few.calls) / more],
            ["of this program's functions", few.own, (many.own - few.own) / more],
            ["in so many files", few.files, ""],
            ["changes of file from one to the next", few.changes, (many.changes - few.changes) / more],
            ["CPU of the main thread, µs", short, (long - short) / more],
        ],
    )
