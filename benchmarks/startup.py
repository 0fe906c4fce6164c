"""What a user waits for, and what waiting costs: start of a run, CPU of a simulation, CPU of idle agents."""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from rich.table import Table

from benchmarks.by_hand import by_hand
from benchmarks.common import ROOT, Row, below, results
from benchmarks.processes import cpu_seconds
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.numbers import number
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.scenario.load import load

_SETTLE_SECONDS, _IDLE_SECONDS = 2.0, 3.0
_LINK_SECONDS = 30.0


def first_step_seconds() -> float:
    """From the launch of `run tracking --no-report` to the last agent's estimate of step 1 in the log."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        began = time.time_ns()
        _cli("run", "tracking", "--no-report", "--set", "steps=20", "--log", str(log))
        times: dict[str, int] = {}
        for message in open_log(log).messages():
            topic = message.channel.topic
            if topic.endswith("/estimate"):
                times.setdefault(topic, message.log_time)
    return 1e-9 * (max(times.values()) - began)


def simulation_cpu_seconds() -> float:
    """User and system time of the whole command `sim tracking`, interpreter and imports with it."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    _cli("sim", "tracking")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (after.ru_utime + after.ru_stime) - (before.ru_utime + before.ru_stime)


def _cli(*arguments: str) -> None:
    subprocess.run(
        [sys.executable, "-m", "zenoh_cbef", *arguments],
        cwd=ROOT,
        check=True,
        capture_output=True,
        timeout=120,
    )


def idle_shares() -> dict[str, float]:
    """Share of one core that each process uses while the run waits for an agent that does not come."""
    overrides = ["record.required=false"]
    present = range(load("tracking").scenario.count - 1)
    with by_hand("tracking", overrides, agents=present) as hand:
        needed = {"target/target", *(f"agent/{agent}" for agent in present)}
        # Peers do not relay tokens, so we look at every process ourselves, and leave before the clock starts.
        with open_session(Connection(connect=list(hand.endpoints.values()), gossip=False)) as session:
            presence = Presence(session, Keys(hand.run).all_live)
            if not presence.wait(lambda live: needed <= live, _LINK_SECONDS):
                raise RuntimeError(f"after {_LINK_SECONDS:g} s only {sorted(presence.names())} are there")
        time.sleep(_SETTLE_SECONDS)
        before, began = {pid: cpu_seconds(pid) for pid in hand.pids.values()}, time.monotonic()
        time.sleep(_IDLE_SECONDS)
        after, seconds = {pid: cpu_seconds(pid) for pid in hand.pids.values()}, time.monotonic() - began
    return {name: (after[pid] - before[pid]) / seconds for name, pid in hand.pids.items()}


def run(repeats: int) -> Iterator[Table]:
    starts = [first_step_seconds() for _ in range(repeats)]
    simulations = [simulation_cpu_seconds() for _ in range(repeats)]
    idle = idle_shares()
    agents = [share for name, share in idle.items() if name.startswith("agent")]
    rows = [
        below("`run tracking` to first step, median", statistics.median(starts), 3.0, "s"),
        Row("`run tracking` to first step, range", f"{number(min(starts))} to {number(max(starts), 's')}"),
        below("CPU of `sim tracking`, median", statistics.median(simulations), 1.0, "s"),
        Row("CPU of `sim tracking`, range", f"{number(min(simulations))} to {number(max(simulations), 's')}"),
        Row("CPU of an idle agent, busiest", f"{max(agents):.2%}", "about 0 %", max(agents) < 0.005),
        Row("CPU of the idle target", f"{idle['target']:.2%}"),
    ]
    yield results(f"start, simulation and idling, {repeats} repeats", rows)
