"""What the benchmarks share: seeded batches, tables with targets, and children that never outlive us."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from zenoh_cbef.analysis.metrics import Analysis, analyze
from zenoh_cbef.numbers import number
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

ROOT = Path(__file__).resolve().parents[1]
SEEDS = 20
Part = TypeVar("Part")


@dataclass(frozen=True)
class Row:
    """One measured quantity; reached is None where there is no target."""

    quantity: str
    measured: str
    target: str = ""
    reached: bool | None = None


def below(quantity: str, value: float, limit: float, unit: str = "", note: str = "") -> Row:
    """Make the row of a quantity that should stay below a limit."""
    return Row(quantity, number(value, unit) + note, f"< {number(limit, unit)}", value < limit)


def at_least(quantity: str, value: float, limit: float, unit: str = "", note: str = "") -> Row:
    """Make the row of a quantity that should reach a limit."""
    return Row(quantity, number(value, unit) + note, f">= {number(limit, unit)}", value >= limit)


def results(title: str, rows: Sequence[Row]) -> Table:
    """Targets beside measured values."""
    table = Table(title=title, title_justify="left")
    for column in ("quantity", "measured", "target", ""):
        table.add_column(column, justify="left" if column in {"quantity", ""} else "right")
    words = {None: "", True: "[green]reached[/green]", False: "[red]not reached[/red]"}
    for row in rows:
        table.add_row(row.quantity, row.measured, row.target, words[row.reached])
    return table


def plain_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> Table:
    """Numbers under column heads; floats in four significant digits."""
    table = Table(title=title, title_justify="left")
    for place, column in enumerate(columns):
        table.add_column(column, justify="right" if place else "left")
    for row in rows:
        table.add_row(*(number(cell) if isinstance(cell, float) else str(cell) for cell in row))
    return table


def followed(parts: Sequence[Part], description: str) -> Iterable[Part]:
    """The parts of something that takes long, with a bar of progress on standard error while they are gone through."""
    return track(parts, description=description, console=Console(stderr=True), transient=True)


def drawn(scenario: Scenario, seeds: int = SEEDS, first: int = 1) -> list[Scenario]:
    """A scenario under so many seeds, from the first one on."""
    return [scenario.changed(seed=seed) for seed in range(first, first + seeds)]


def analyses(name: str, overrides: Sequence[str] = (), *, seeds: int = SEEDS) -> list[Analysis]:
    """Simulate and analyse a scenario under seeds 1, 2, ..., as one batch; a run that diverges shows in the figures."""
    with np.errstate(all="ignore"):
        return analyze(simulate(drawn(load(name, overrides).scenario, seeds)))


class Children:
    """Child processes that hold the other end of a pipe to us, and end when it closes."""

    def __init__(self) -> None:
        self.processes: list[subprocess.Popen[bytes]] = []
        self._words: dict[int, IO[bytes]] = {}

    def start(
        self,
        module: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        *,
        listen_to: bool = False,
        launcher: Sequence[str] = (),
    ) -> subprocess.Popen[bytes]:
        """Start `python -m module arguments`, or a launcher of it; listen_to keeps its standard output for us."""
        words = tempfile.TemporaryFile()  # noqa: SIM115 - closed by kill()
        process = subprocess.Popen(
            [*launcher, sys.executable, "-m", module, *arguments],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE if listen_to else subprocess.DEVNULL,
            stderr=words,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"} | dict(environment),
            start_new_session=True,
        )
        self.processes.append(process)
        self._words[process.pid] = words
        return process

    def wait(self, process: subprocess.Popen[bytes], seconds: float) -> str:
        """Wait for a process that was started with listen_to; returns what it printed.

        Not by communicate(), which would close the pipe that it ends with. Raises RuntimeError if it fails, or
        does not end in time.
        """
        try:
            status = process.wait(max(0.1, seconds))
        except subprocess.TimeoutExpired:
            raise RuntimeError(f"a benchmark's process did not end within {seconds:.0f} s") from None
        if status != 0:
            words = self._words[process.pid]
            words.seek(0)
            raise RuntimeError(f"a benchmark's process ended with status {status}: {words.read().decode()}")
        assert process.stdout is not None
        return process.stdout.read().decode()

    def kill(self) -> None:
        """End all of them now."""
        for process in self.processes:
            if process.poll() is None:
                process.kill()
        for process in self.processes:
            process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    pipe.close()
            self._words[process.pid].close()


@contextmanager
def children() -> Iterator[Children]:
    """Children of a block; none is left when it ends, however it ends."""
    family = Children()
    try:
        yield family
    finally:
        family.kill()


def interrupt_on_terminate() -> None:
    """Turn SIGTERM into KeyboardInterrupt, so that what is open is closed."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
