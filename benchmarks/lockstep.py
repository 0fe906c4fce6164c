"""Rounds per second of real agents in lockstep, recorder on, against a bare exchange of the same messages."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from rich.table import Table

from benchmarks.bare_exchange import RUNTIMES, bare_rate
from benchmarks.common import Row, at_least, results
from zenoh_cbef.nodes.common.recording import Status
from zenoh_cbef.nodes.launch.launcher import Launcher
from zenoh_cbef.scenario.load import load

STEPS = {"tracking": 1200, "scale24": 250}
_OURS = "agents, recorder on"


class _Pace:
    """Steps per second by the recorder's reports, between a tenth and the last report before the end."""

    def __init__(self, steps: int) -> None:
        self._steps = steps
        self._reports: list[tuple[float, int]] = []

    def note(self, status: Status) -> None:
        """Take in one report."""
        if self._steps / 10 <= status.step < self._steps:
            self._reports.append((time.monotonic(), status.step))

    @property
    def rate(self) -> float:
        """Steps per second."""
        (began, first), (ended, last) = self._reports[0], self._reports[-1]
        return (last - first) / (ended - began)


def agents_rate(name: str, steps: int) -> float:
    """Measure the rounds per second of one real run, every process its own, recorder on."""
    setting = f"steps={steps}"
    loaded, pace = load(name, [setting]), _Pace(steps)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        run = f"lockstep-{name}-{time.time_ns()}"
        with Launcher([name, "--set", setting], loaded, run, path) as launcher:
            launcher.watch(pace.note, lambda: 0)
            if launcher.deaths:
                raise RuntimeError(str(launcher.deaths[0]))
    return pace.rate * loaded.plan.rounds


def measure(name: str, repeats: int) -> dict[str, list[float]]:
    """Measure every arm's rounds per second, interleaved: a busy minute of the machine hits all alike."""
    plan = load(name).plan
    edges = [(first, second) for first, second in plan.edges.tolist()]
    size = 8 * plan.message_size
    rounds = plan.rounds * STEPS[name]
    rates: dict[str, list[float]] = {_OURS: [], **{arm: [] for arm in RUNTIMES}}
    for _ in range(repeats):
        for arm, environment in RUNTIMES.items():
            rates[arm].append(bare_rate(edges, plan.scenario.count, rounds=rounds, size=size, environment=environment))
        rates[_OURS].append(agents_rate(name, STEPS[name]))
    return rates


def run(repeats: int) -> Iterator[Table]:
    for name in STEPS:
        plan = load(name).plan
        edges, size = plan.edges, 8 * plan.message_size
        busy = os.getloadavg()[0]
        rates = measure(name, repeats)
        title = f"{name}: {plan.scenario.count} agents, {len(edges)} edges, {size} bytes, medians of {repeats}"
        yield results(title, [*_rows(rates), Row("load average before", f"{busy:.1f}")])


def _rows(rates: dict[str, list[float]]) -> list[Row]:
    medians = {arm: statistics.median(values) for arm, values in rates.items()}
    rows = [
        Row(
            arm if arm == _OURS else f"bare exchange, {arm}",
            f"{medians[arm]:.0f} rounds/s ({min(values):.0f} to {max(values):.0f})",
        )
        for arm, values in rates.items()
    ]
    # Pairs that were measured one after the other: what else the machine does cancels out of their ratio.
    faster = max(RUNTIMES, key=lambda arm: medians[arm])
    shares = [ours / bare for ours, bare in zip(rates[_OURS], rates[faster], strict=True)]
    note = f" ({min(shares):.2f} to {max(shares):.2f})"
    best = max(rates[_OURS]) / max(max(rates[arm]) for arm in RUNTIMES)
    return [
        *rows,
        at_least(f"agents / bare, {faster}, pair by pair", statistics.median(shares), 0.5, note=note),
        # Other processes can only slow a run down, so where the pairs differ widely this is nearer to the truth.
        at_least("best agents / best bare", best, 0.5),
    ]
