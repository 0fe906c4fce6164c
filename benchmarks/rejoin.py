"""How soon errors are as before: after an agent was killed and started again, and after a network was cut in two."""

from __future__ import annotations

import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import cast

import numpy as np
from rich.table import Table

from benchmarks.common import ROOT, Row, below, drawn, results
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.trace import Trace

SEEDS, AGENT, SETTLED = 50, 2, 20
GONE, BACK = 100, 150
TIMES = f"from = {GONE / 10}, until = {BACK / 10}"
COMMAND = [sys.executable, "-m", "zenoh_cbef"]


def simulated(fault: str) -> list[Trace]:
    """`tracking` with a fault, many seeds."""
    return simulate(drawn(load("tracking", [f"fault=[{{{fault}, {TIMES}}}]"]).scenario, SEEDS))


def against_neighbours(trace: Trace, first: int) -> float:
    """The error of the agent that came back at a step, over the mean of its neighbours', a while later."""
    joined = sorted({one for edge in trace.edges.tolist() if AGENT in edge for one in edge} - {AGENT})
    error = np.linalg.norm(trace.estimates[:, :, :3] - trace.truth[:, :3], axis=2)[:, first - 1 + SETTLED]
    return float(error[AGENT] / error[joined].mean())


def steps_to_agree() -> list[int]:
    """Steps from the healing until the disagreement is below its mean of the five seconds before the cut."""
    found = []
    for analysis in analyze(simulated('kind = "partition", links = {between = [[0, 1, 2], [3, 4, 5]]}')):
        before = analysis.disagreement[GONE - 51 : GONE - 1].mean()
        after = np.flatnonzero(analysis.disagreement[BACK - 1 :] < before)
        found.append(int(after[0]) if after.size else len(analysis.disagreement))
    return found


def killed_and_started_again(mode: str) -> tuple[float, float]:
    """Seconds from the start of the new process to its first estimate, and its error over its neighbours' later."""
    steps = 1500 if mode == "lockstep" else 120
    with tempfile.TemporaryDirectory() as folder:
        log, run = Path(folder) / "run.mcap", f"rejoin-{os.getpid()}-{time.time_ns()}"
        overrides = ["--set", f"timing.mode={mode}", "--set", f"steps={steps}"]
        options = ["--run", run, "--log", str(log), "--no-report"]
        with _started("run", "tracking", *overrides, *options) as whole:
            active = log.with_name("run.mcap.active")
            while not (active.exists() and active.stat().st_size > 30_000):
                time.sleep(0.02)
            pid, command = _agent_of(run)
            os.kill(pid, signal.SIGKILL)
            time.sleep(0.2)
            began = time.time_ns()
            with _started(*command):
                whole.wait()
        first = min(
            one.publish_time
            for one in open_log(log).messages()
            if one.channel.topic.endswith(f"agent/{AGENT}/estimate") and one.publish_time > began
        )
        trace = read_trace(log)
        [joined] = [cast("dict[str, int]", one["data"]) for one in trace.events if one["kind"] == "joined"]
        return 1e-9 * (first - began), against_neighbours(trace, joined["step"])


def _started(*arguments: str) -> subprocess.Popen[bytes]:
    quiet = subprocess.DEVNULL
    return subprocess.Popen([*COMMAND, *arguments], cwd=ROOT, stdout=quiet, stderr=quiet)


def _agent_of(run: str) -> tuple[int, list[str]]:
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            words = (entry / "cmdline").read_bytes().decode(errors="replace").replace("\0", " ").split()
            if run in words and ["agent", str(AGENT)] == words[words.index("zenoh_cbef") + 1 :][:2]:
                return int(entry.name), words[words.index("zenoh_cbef") + 1 :]
    raise RuntimeError(f"run {run} has no agent {AGENT}")


def run(repeats: int) -> Iterable[Table]:
    """Measure."""
    yield results("after a cut, and after a crash, 50 seeds", _healing())
    yield results("an agent that was killed and started again", _rejoining(repeats))


def _healing() -> Sequence[Row]:
    steps, median = steps_to_agree(), statistics.median
    ratios = [against_neighbours(trace, BACK) for trace in simulated(f'kind = "crash", agents = [{AGENT}]')]
    return [
        below(
            "steps from healing to the former disagreement, worst", max(steps), 20, "", f" (median {median(steps):g})"
        ),
        below("error after a crash over the neighbours', 20 steps later", median(ratios), 1.1),
        below("... worst", max(ratios), 1.1),
    ]


def _rejoining(repeats: int) -> Sequence[Row]:
    rows = []
    for mode in ("lockstep", "realtime"):
        measured = [killed_and_started_again(mode) for _ in range(repeats)]
        seconds, ratios = (statistics.median(values) for values in zip(*measured, strict=True))
        rows.append(below(f"{mode}: from start to first estimate, median of {repeats}", seconds, 2.0, "s"))
        rows.append(below(f"{mode}: error over the neighbours', 20 steps later", ratios, 1.1))
    return rows
