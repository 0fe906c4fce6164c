"""What n agents ask of links, messages, bytes and memory: formulas, runs that were counted, and simulations.

The formulas are those of zenoh_cbef/analysis/demand.py. The figures of docs/scale.md are written to docs/figures.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import matplotlib as mpl
from rich.table import Table

from benchmarks.common import plain_table
from benchmarks.method_figures import FOLDER, STYLE, canvas, save
from benchmarks.scale_counted import Counted, counted
from zenoh_cbef.analysis.demand import Demand, Load, demand
from zenoh_cbef.analysis.figures import COLOURS
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate

GRID = "network.graph=grid"
SIZES = (6, 24, 100, 300, 1000)
_ROUNDS = (10, 40)
_STEPS = 60
_LINES = (("agent", False), ("target", False), ("recorder", False), ("router", True))
_COUNTED = {"links": "links", "bytes_received": "into", "memory": "memory"}


def plan_of(agents: int, *overrides: str) -> Plan:
    """`tracking` with so many agents in the same cube, linked as a grid: four neighbours each, however many."""
    return load("tracking", [f"agents.count={agents}", GRID, *overrides]).plan


def _loads(told: Demand) -> Iterator[tuple[str, Load]]:
    yield from {"agent": told.agent, "target": told.target, "recorder": told.recorder}.items()
    if told.router:
        yield "router", told.router


def _on_paper(*, routed: bool) -> Table:
    rows: list[list[object]] = []
    for agents in SIZES:
        for name, one in _loads(demand(plan_of(agents), routed=routed)):
            if name == "agent" or (name == "router") == routed:
                sizes = one.bytes_sent / 1e3, one.bytes_received / 1e3, one.memory / 1e6
                rows.append([f"{agents}: {name}", one.links, one.sent, one.received, *map(float, sizes), one.files])
    way = "through a router" if routed else "linked by graph"
    columns = ["agents", "links", "sent", "received", "sent (kB)", "received (kB)", "memory (MB)", "files"]
    return plain_table(f"a step on paper, {way}; grid, L = 10", columns, rows)


def _compared(runs: Sequence[Counted]) -> Table:
    rows: list[list[object]] = []
    for run in runs:
        for name, one in _loads(demand(run.plan)):
            told = [one.received, run.heard] if name == "recorder" else ["", ""]
            paper = [one.links, one.bytes_sent / 1e3, one.bytes_received / 1e3, one.memory / 1e6]
            found = [run.links[name], run.out[name] / 1e3, run.into[name] / 1e3, run.memory[name] / 1e6]
            rows.append([f"{run.agents}: {name}, formula", told[0], *map(float, paper)])
            rows.append([f"{run.agents}: {name}, counted", told[1], *map(float, found)])
    columns = ["agents", "messages", "links", "sent (kB)", "received (kB)", "memory (MB)"]
    return plain_table("a step, formula and counted (messages in the log; links and bytes of sockets)", columns, rows)


def _speeds(runs: Sequence[Counted]) -> Table:
    rows = [[run.agents, *(1e3 * run.cpu[name] for name in ("agent", "target", "recorder")), run.cores] for run in runs]
    columns = ["agents", "agent (ms)", "target (ms)", "recorder (ms)", "cores for 10 Hz"]
    return plain_table("CPU time of a step of each process, and cores that all need for a dt of 0.1 s", columns, rows)


def _simulated() -> Table:
    rows: list[list[object]] = []
    for agents in SIZES:
        for rounds in _ROUNDS:
            for scheme in ("none", "chebyshev"):
                scenario = plan_of(
                    agents, f"steps={_STEPS}", f"consensus.rounds={rounds}", f"consensus.acceleration={scheme}"
                ).scenario
                began = time.process_time()
                [one] = analyze(simulate([scenario]))
                seconds = time.process_time() - began
                metrics = one.metrics
                ratio = metrics.ratio_to_centralized or float("nan")
                rows.append([f"{agents}, L = {rounds}, {scheme}", ratio, metrics.position_rmse, seconds])
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    title = f"simulated and analysed, {_STEPS} steps, one seed; largest memory {most:.0f} MB"
    return plain_table(title, ["agents", "ratio to centralised", "position RMSE (m)", "CPU (s)"], rows)


def _panels(folder: Path, runs: Sequence[Counted]) -> None:
    figure, panels = canvas(3)
    ways = {
        routed: [dict(_loads(demand(plan_of(agents), routed=routed))) for agents in SIZES] for routed in (False, True)
    }
    parts = (("links", "links", 1.0), ("bytes_received", "kB received in a step", 1e3), ("memory", "memory (MB)", 1e6))
    for axes, (part, label, unit) in zip(panels, parts, strict=True):
        for (name, routed), colour in zip(_LINES, COLOURS, strict=False):
            values = [getattr(one[name], part) / unit for one in ways[routed]]
            axes.plot(SIZES, values, "--" if routed else "-", color=colour, label=name)
            found = [getattr(run, _COUNTED[part]).get(name) for run in runs if not routed]
            axes.plot(
                [run.agents for run in runs][: len(found)],
                [one / unit for one in found],
                "o",
                color=colour,
                markersize=4,
            )
        axes.set(xlabel="agents", ylabel=label, xscale="log", yscale="log")
    panels[0].legend(frameon=False)
    save(figure, folder, "demand")


def run(repeats: int, agents: str | None = None, folder: Path = FOLDER) -> Iterator[Table]:
    """Formulas, then runs of so many agents as processes, as in "24,100", then simulations."""
    del repeats
    yield _on_paper(routed=False)
    yield _on_paper(routed=True)
    runs = [counted(int(number), GRID) for number in (agents or "24,100").split(",")]
    yield _compared(runs)
    yield _speeds(runs)
    with mpl.rc_context(STYLE):
        folder.mkdir(parents=True, exist_ok=True)
        _panels(folder, runs)
    yield _simulated()
