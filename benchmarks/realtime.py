"""The highest step rate at which a realtime run is on time, and how long its messages take there.

Every point is a run as `zenoh-cbef run` makes it: target, agents and recorder as processes, with the scenario's own
settings but for the mode, the step, and L. Late is what its receiver counted as late or lost, of all messages of
consensus that were due, from a tenth of the run to its end.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.common import at_least, plain_table, results
from zenoh_cbef.analysis.slowness import slowness
from zenoh_cbef.arrays import Floats
from zenoh_cbef.log.read.parts import open_logs
from zenoh_cbef.log.read.recording import read_recording
from zenoh_cbef.log.read.trace import trace_of
from zenoh_cbef.nodes.launch.attempts import launch
from zenoh_cbef.scenario.load import load

LIMIT = 1e-3
"""Of the messages of a run that is on time fewer are late."""
GOAL = "tracking", 10, 100.0
"""Scenario, L, and the steps per second that it is to keep."""
_SCENARIOS = "tracking", "scale24"
_DECADE = (1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 3.9, 4.7, 5.6, 6.8, 8.2)
RUNGS = [*_DECADE, *(10.0 * one for one in _DECADE), 100.0, 120.0, 150.0, 180.0, 220.0]
"""Steps per second that are tried, each a fifth more than the one before."""
_ROUNDS = 10, 5
"""L, the most first: fewer rounds need not be tried at lower rates."""
_SECONDS, _FEWEST_STEPS = 3.0, 20


@dataclass(frozen=True)
class Point:
    """One run. late: the share of messages. latency: s, of each link and step the mean of its messages, (m,).

    slowest: the share of rounds that the slowest agent began after their deadline. beacons: the share of steps whose
    beacons the target sent too late.
    """

    late: float
    latency: Floats
    slowest: float
    beacons: float


def measure(name: str, rounds: int, rate: float, overrides: Sequence[str] = ()) -> Point:
    """Run a scenario in realtime, so many steps per second. Raises RuntimeError if a process fails."""
    steps = max(_FEWEST_STEPS, round(rate * _SECONDS))
    settings = [f"consensus.rounds={rounds}", f"dt={1.0 / rate!r}", f"steps={steps}", "timing.mode=realtime"]
    settings += overrides
    arguments = [name, *(part for one in settings for part in ("--set", one))]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        launcher = launch(arguments, load(name, settings), f"realtime-{name}-{time.time_ns()}", path)
        if launcher.deaths:
            raise RuntimeError(str(launcher.deaths[0]))
        recording = read_recording(open_logs([path]))
    parts = [receipts.fresh(steps // 10, steps)[1] for receipts in recording.receipts]
    received, lost, late = (sum(float(np.nansum(part[:, place])) for part in parts) for place in range(3))
    latency = np.concatenate([part[:, 3].ravel() for part in parts])
    slow = slowness(trace_of(recording))
    agents = [share or 0.0 for share in slow.agents] if slow else [0.0]
    beacons = (slow.target or 0.0) if slow else 0.0
    return Point((lost + late) / (received + lost + late), latency[np.isfinite(latency)], max(agents), beacons)


def highest(rungs: Sequence[float], holds: Callable[[float], bool]) -> float | None:
    """The last of ascending rungs that holds, where all below one that holds do, too; None: not even the first."""
    low, high = 0, len(rungs)
    while low < high:
        middle = (low + high) // 2
        if holds(rungs[middle]):
            low = middle + 1
        else:
            high = middle
    return rungs[low - 1] if low else None


def on_time(run_at: Callable[[float], Point], rungs: Sequence[float], repeats: int) -> tuple[float, list[Point]]:
    """The highest rate of which the median of `repeats` runs is on time, and these runs; the lowest rung if none is.

    It is looked for with single runs. Other work of the machine can only make messages late, so a run that is not on
    time is made once more there.
    """

    def holds(rate: float) -> bool:
        return any(run_at(rate).late < LIMIT for _ in range(2))

    found = highest(rungs, holds) or rungs[0]
    for rate in reversed([rung for rung in rungs if rung <= found]):
        points = [run_at(rate) for _ in range(repeats)]
        if kept(points):
            break
    return rate, points


def kept(points: Sequence[Point]) -> bool:
    """Whether the median of some runs is on time."""
    return statistics.median(point.late for point in points) < LIMIT


def run(repeats: int, set: Sequence[str] = ()) -> Iterator[Table]:  # noqa: A002 - the option's name
    rows, reached = [], []
    for name in _SCENARIOS:
        least = 0.0
        for rounds in _ROUNDS:
            busy, count = os.getloadavg()[0], load(name).scenario.count
            run_at = partial(measure, name, rounds, overrides=set)
            least, points = on_time(run_at, [rung for rung in RUNGS if rung >= least], repeats)
            rows.append([f"{count}, L = {rounds}", *_cells(least, points), f"{busy:.1f}"])
            if (name, rounds) == GOAL[:2]:
                reached = [at_least(f"{count} agents, L = {rounds}: steps/s", least * kept(points), GOAL[2])]
    columns = ["agents", "steps/s", "late, %", "slowest agent, %", "beacons, %", "p50, ms", "p99, ms", "p99.9, ms"]
    title = f"highest step rate with under {100 * LIMIT:g} % of messages late, medians of {repeats}; latency there"
    yield plain_table(title, [*columns, "max, ms", "load before"], rows)
    yield results("", reached)


def _cells(rate: float, points: Sequence[Point]) -> list[object]:
    """A row: rate, medians of the shares in per cent, and quantiles of all runs' latencies in ms."""
    latency = 1e3 * np.concatenate([point.latency for point in points])
    shares = np.median([(point.late, point.slowest, point.beacons) for point in points], axis=0)
    quantiles = np.quantile(latency, [0.5, 0.99, 0.999, 1.0])
    return [
        f"{rate:g}" if kept(points) else f"below {rate:g}",
        *(f"{100.0 * one:.3f}" for one in shares),
        *(f"{one:.2f}" for one in quantiles),
    ]
