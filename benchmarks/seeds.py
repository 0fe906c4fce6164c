"""A thousand seeds, clean and lossy, simulated and analysed on one core; the bits of single runs; other libraries."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from rich.table import Table

from benchmarks.beside import compared
from benchmarks.common import Row, below, results
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.experiment.cores import batches
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.trace import Trace

SEEDS, SINGLE, BESIDE = 1000, 20, 30
LOSS = "fault=[{kind='loss', probability=0.3}]"
CASES = {"clean": ([], 12.0), "30 % loss": ([LOSS], 15.0)}
"""Settings, and the CPU that a thousand seeds should take, s."""


def runs(seeds: Sequence[int], settings: Sequence[str]) -> list[Scenario]:
    """`tracking` with these settings."""
    scenario = load("tracking", settings).scenario
    return [scenario.changed(seed=seed) for seed in seeds]


def analysed(seeds: Sequence[int], settings: Sequence[str]) -> list[Trace]:
    """The runs, simulated as one batch and analysed."""
    traces = simulate(runs(seeds, settings))
    analyze(traces)
    return traces


def digest(trace: Trace) -> str:
    """What must be the same: estimates and covariances to the last bit."""
    content = np.ascontiguousarray(trace.estimates).tobytes() + np.ascontiguousarray(trace.covariances).tobytes()
    return hashlib.sha256(content).hexdigest()


def in_batches(seeds: Sequence[int], settings: Sequence[str]) -> tuple[float, dict[int, str]]:
    """CPU seconds of simulation and analysis, and the digests, by seed, of the runs that are looked at."""
    spent = 0.0
    digests: dict[int, str] = {}
    checked = set(seeds[:: max(1, len(seeds) // SINGLE)])
    size = -(-len(seeds) // batches(load("tracking", settings).scenario, len(seeds), jobs=1))
    for start in range(0, len(seeds), size):
        begin = time.process_time()
        traces = analysed(seeds[start : start + size], settings)
        spent += time.process_time() - begin
        digests |= {one.scenario.seed: digest(one) for one in traces if one.scenario.seed in checked}
    return spent, digests


def rows(seeds: Sequence[int], case: str) -> list[Row]:
    """CPU time against its target, and how many of the checked seeds have the bits of a single run."""
    settings, limit = CASES[case]
    spent, digests = in_batches(seeds, settings)
    same = sum(digest(simulate(runs([seed], settings))[0]) == found for seed, found in digests.items())
    return [
        below(f"{len(seeds)} seeds, {case}, CPU of simulation and analysis", spent, limit, "s"),
        Row(
            "seeds with the bits of a single run", f"{same}", f"{len(digests)} of {len(digests)}", same == len(digests)
        ),
    ]


def run(repeats: int) -> Iterator[Table]:
    """The thousand seeds once, as they take long; what stands beside other libraries `repeats` times, in turn."""
    title = "tracking, 6 agents, 300 steps, L = 10"
    yield results(title, [row for case in CASES for row in rows(range(1, SEEDS + 1), case)])
    ours = partial(analysed, range(1, BESIDE + 1), CASES["clean"][0])
    yield results(f"{title}, {BESIDE} seeds", list(compared(ours, "clean", repeats)))
