"""Rounds per second of the same consensus loop over ZeroMQ, MPI and Unix sockets, in turn with ours and bare Zenoh.

ZeroMQ and MPI are for this benchmark only: an arm whose package is not installed is left out, and says so.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from rich.table import Table

from benchmarks.bare_exchange import RUNTIMES, bare_rate
from benchmarks.common import Row, plain_table, results
from benchmarks.exchange_part import Outcome
from benchmarks.exchanging import exchanged, parts_of, slowest
from benchmarks.rival_process import Loop
from benchmarks.round import RINGS, WITHOUT, agents
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan

STEPS = {"tracking": 150, "scale24": 30}
PACKAGES = {"unix": (), "zeromq": ("pyzmq",), "mpi": ("mpi4py", "openmpi")}
_TITLES = {"unix": "Unix sockets", "zeromq": "ZeroMQ", "mpi": "MPI"}
_SETTINGS = {
    "OMPI_MCA_mpi_yield_when_idle": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "MPIR_CVAR_POLLS_BEFORE_YIELD": "1",
    "MPIR_CVAR_POSIX_POLL_FREQUENCY": "1",
}
"""MPI waits in a loop; Open MPI and MPICH leave the core to others in it with these, as processes are more than cores.

Open MPI also asks to be told that so many processes, and an administrator's, are meant.
"""


def rival(plan: Plan, way: str, steps: int, *, batch: bool) -> list[Outcome]:
    """Run a rival's processes once, with batch scheduling or without; what each of them tells.

    Raises RuntimeError where one fails, or hangs.
    """
    count, present = plan.scenario.count, plan.neighbours.present
    weights = [plan.weights[agent, present[agent]].tolist() for agent in range(count)]
    bounds = plan.bounds.tolist() if plan.scenario.consensus.acceleration == "chebyshev" else []
    loop = Loop(way, batch, steps, plan.rounds, plan.message_size, weights, bounds, os.getpid())
    launcher = [_mpiexec(), "-n", str(count)] if way == "mpi" else []
    with tempfile.TemporaryDirectory() as folder:
        parts = parts_of(_edges(plan), [str(Path(folder) / str(agent)) for agent in range(count)])
        told = [json.dumps(asdict(loop))]
        return exchanged("benchmarks.rival_process", parts, told, environment=_SETTINGS, launcher=launcher)


def lacking(way: str) -> str:
    """What to install for a way, "" where all is there."""
    modules = {"zeromq": "zmq", "mpi": "mpi4py"}
    there = way not in modules or (find_spec(modules[way]) is not None and (way != "mpi" or _mpiexec()))
    return "" if there else f"pip install {' '.join(PACKAGES[way])}"


def _mpiexec() -> str:
    """The launcher of the MPI that is installed beside this Python, else the system's; "" where there is none."""
    return shutil.which("mpiexec", path=str(Path(sys.executable).parent)) or shutil.which("mpiexec") or ""


def _edges(plan: Plan) -> list[tuple[int, int]]:
    return [(first, second) for first, second in plan.edges.tolist()]


def _faster(plan: Plan, way: str, steps: int) -> bool:
    """Whether a rival is faster with batch scheduling than without, one run each."""
    with_it, without = (slowest(rival(plan, way, steps, batch=batch)) for batch in (True, False))
    return with_it > without


def arms(name: str) -> dict[str, Callable[[], float]]:
    """What measures the rounds per second of each arm of a scenario, ours first."""
    plan, steps = load(name).plan, STEPS[name]
    rounds, size = plan.rounds * steps, 8 * plan.message_size
    found: dict[str, Callable[[], float]] = {
        f"ours, {arm}": partial(_agents, name, steps, arm) for arm in (WITHOUT, RINGS)
    }
    bare = partial(bare_rate, rounds=rounds, size=size, environment=RUNTIMES["merged runtime"])
    found["bare Zenoh, no averaging"] = partial(bare, _edges(plan), plan.scenario.count)
    for way, title in _TITLES.items():
        if not lacking(way):
            batch = _faster(plan, way, steps)
            found[f"{title}{', batch scheduling' * batch}"] = partial(_rival, plan, way, steps, batch)
    return found


def _agents(name: str, steps: int, arm: str) -> float:
    return agents(name, steps, arm).rate


def _rival(plan: Plan, way: str, steps: int, batch: bool) -> float:
    return slowest(rival(plan, way, steps, batch=batch))


def run(repeats: int) -> Iterator[Table]:
    """All arms in turn, so that other work of the machine slows all of them; medians."""
    missing = [Row(f"{_TITLES[way]} is left out", f"run: {why}") for way in _TITLES if (why := lacking(way))]
    if missing:
        yield results("arms that are not measured", missing)
    for name in STEPS:
        busy, plan = os.getloadavg()[0], load(name).plan
        measured = arms(name)
        rates = {arm: list[float]() for arm in measured}
        for _ in range(repeats):
            for arm, rate in measured.items():
                rates[arm].append(rate())
        title = (
            f"{name}: {plan.scenario.count} agents, {len(plan.edges)} edges, L = {plan.rounds}, payloads of "
            f"{8 * plan.message_size} bytes, medians of {repeats}, load before {busy:.1f}"
        )
        yield plain_table(title, ["rounds/s", "median", "from, to", "over ours", "from, to"], _rows(rates))


def _rows(rates: dict[str, list[float]]) -> list[list[str]]:
    """Each arm's rates, and over those of our agents without recorder that were measured in the same turn."""
    ours = next(iter(rates.values()))
    rows = []
    for arm, found in rates.items():
        shares = [one / own for one, own in zip(found, ours, strict=True)]
        spread = f"{min(found):.0f}, {max(found):.0f}"
        share = f"{statistics.median(shares):.2f}", f"{min(shares):.2f}, {max(shares):.2f}"
        rows.append([arm, f"{statistics.median(found):.0f}", spread, *share])
    return rows
