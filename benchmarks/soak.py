"""Memory of a realtime run over time: how fast each process grows, with the interval in which that is known."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.common import Row, children, results
from zenoh_cbef.scenario.load import load

MINUTES = 10.0
_EVERY_SECONDS = 5.0
_WARM_UP = 0.35
"""Share of the run that is left out: until then mailboxes are filled for the first time."""
_RUN = "soak"

Sample = tuple[float, float]


def slope(samples: Sequence[Sample]) -> tuple[float, float]:
    """How much y grows with x, and the half width of its 95 % interval.

    samples: x and y. Neighbouring residuals are alike, so there are fewer independent ones than samples: by their
    correlation, as for a first-order autoregression. Both are NaN for fewer than four samples.
    """
    if len(samples) < 4:
        return math.nan, math.nan
    x, y = np.array(samples).T
    x = x - x.mean()
    rate = float(x @ (y - y.mean()) / (x @ x))
    rest = y - y.mean() - rate * x
    power = float(rest @ rest)
    alike = 0.0 if power == 0.0 else min(0.99, max(0.0, float(rest[1:] @ rest[:-1]) / power))
    return rate, 1.96 * math.sqrt(power / (len(x) - 2) / float(x @ x) * (1.0 + alike) / (1.0 - alike))


def _resident(run: str) -> dict[str, float]:
    """Resident memory (kB) of the processes of a run, by what they are."""
    found = {}
    for place in Path("/proc").glob("[0-9]*"):
        try:
            words = (place / "cmdline").read_text().replace("\0", " ").split()
            status = (place / "status").read_text()
        except OSError:
            continue
        if run in words and "zenoh_cbef" in words and "VmRSS:" in status:
            role, name = words[words.index("zenoh_cbef") + 1 :][:2]
            size = float(status.partition("VmRSS:")[2].split()[0])
            found[f"agent {name}" if role == "agent" else role] = size
    return found


def measure(minutes: float) -> dict[str, list[Sample]]:
    """Time (s) and resident memory (kB) of every process of `tracking` in realtime."""
    dt = load("tracking").scenario.dt
    steps = ["--set", "timing.mode=realtime", "--set", f"steps={round(60.0 * minutes / dt)}"]
    samples: dict[str, list[Sample]] = {}
    with tempfile.TemporaryDirectory() as folder, children() as family:
        log = str(Path(folder) / "run.mcap")
        run = f"{_RUN}-{Path(folder).name}"
        arguments = ["run", "tracking", *steps, "--run", run, "--log", log, "--no-report"]
        process = family.start("zenoh_cbef", arguments, {})
        began = time.monotonic()
        while process.poll() is None and time.monotonic() - began < 60.0 * minutes:
            time.sleep(_EVERY_SECONDS)
            for name, size in _resident(run).items():
                samples.setdefault(name, []).append((time.monotonic() - began, size))
    samples.pop("run", None)  # It analyses the log at the end.
    return samples


def run(repeats: int, minutes: float = MINUTES) -> Iterator[Table]:
    del repeats  # time is what is repeated
    rows = []
    for name, samples in sorted(measure(minutes).items()):
        counted = [one for one in samples if one[0] >= _WARM_UP * 60.0 * minutes]
        rate, half = slope(counted)
        text = f"{rate:+.2f} +- {half:.2f} kB/s, {counted[-1][1] / 1024:.0f} MB at the end" if counted else "-"
        rows.append(Row(name, text, "0 in the interval", bool(rate - half <= 0.0)))
    yield results(f"memory of tracking in realtime, {minutes:g} minutes, 95 % intervals", rows)
