"""A thousand seeds of a lossy run, simulated and analysed on one core; and whether single runs have the same bits."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator, Sequence

import numpy as np
from rich.table import Table

from benchmarks.common import Row, below, results
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.trace import Trace

SEEDS, AT_ONCE, SINGLE = 1000, 60, 20
LOSS = "fault=[{kind='loss', probability=0.3}]"


def runs(seeds: Sequence[int]) -> list[Scenario]:
    """`tracking` with every message lost with a probability of 30 %."""
    scenario = load("tracking", [LOSS]).scenario
    return [scenario.model_copy(update={"seed": seed}) for seed in seeds]


def digest(trace: Trace) -> str:
    """What must be the same: estimates and covariances to the last bit."""
    content = np.ascontiguousarray(trace.estimates).tobytes() + np.ascontiguousarray(trace.covariances).tobytes()
    return hashlib.sha256(content).hexdigest()


def in_batches(seeds: Sequence[int]) -> tuple[float, dict[int, str]]:
    """CPU seconds of simulation and analysis, and the digests, by seed, of the runs that are looked at."""
    spent = 0.0
    digests: dict[int, str] = {}
    checked = set(seeds[:: max(1, len(seeds) // SINGLE)])
    for start in range(0, len(seeds), AT_ONCE):
        begin = time.process_time()
        traces = simulate(runs(seeds[start : start + AT_ONCE]))
        analyze(traces)
        spent += time.process_time() - begin
        digests |= {one.scenario.seed: digest(one) for one in traces if one.scenario.seed in checked}
    return spent, digests


def rows(seeds: Sequence[int]) -> list[Row]:
    """CPU time against its target, and how many of the checked seeds have the bits of a single run."""
    spent, digests = in_batches(seeds)
    same = sum(digest(simulate(runs([seed]))[0]) == found for seed, found in digests.items())
    return [
        below(f"{len(seeds)} seeds, CPU of simulation and analysis", spent, 20.0, "s"),
        Row(
            "seeds with the bits of a single run", f"{same}", f"{len(digests)} of {len(digests)}", same == len(digests)
        ),
    ]


def run(repeats: int) -> Iterator[Table]:
    """Long enough not to be repeated."""
    del repeats
    yield results("tracking, 6 agents, 300 steps, L = 10, 30 % loss", rows(range(1, SEEDS + 1)))
