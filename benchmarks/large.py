"""Simulations of very many agents: seconds of a step, memory, and by which power of the agents both grow.

Agents are placed at random in a cube that grows with them and are linked with those near, eight on average; the few
near the middle, where the target begins, hear it. Each size has a process of its own, so its memory is its own.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from rich.table import Table

from benchmarks.common import Row, below, children, plain_table, results
from benchmarks.exchange_part import end_with_parent
from benchmarks.method_figures import FOLDER, STYLE, canvas, save
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.paths import placement
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.size import simulation_bytes
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.near import pairs_within

SIZES = (1000, 10_000, 100_000)
MILLION = 1_000_000
_STEPS, _DEGREE, _REACH = 6, 8, 30.0
_SPACING = 10.0
"""Edge of the cube that an agent has to itself, m."""
_PATIENCE = 7200.0
_SECONDS, _GIBIBYTES = 3.0, 20.0


@dataclass(frozen=True)
class Large:
    """What simulating and analysing so many agents took: CPU time in s, memory in bytes.

    degree: neighbours of an agent, mean. hearing: agents that heard the target. beforehand: the memory that the user
    is told before. started: that of the process before.
    """

    agents: int
    degree: float
    hearing: int
    set_up: float
    step: float
    analysis: float
    memory: int
    beforehand: int
    started: int


def scenario_of(agents: int, steps: int = _STEPS) -> Scenario:
    """`tracking` with so many agents, each linked to eight others on average."""
    edge = _SPACING * agents ** (1.0 / 3.0)
    middle = [0.5 * edge] * 3
    keys = [f"agents.count={agents}", "agents.low=0.0", f"agents.high={edge}", f"target.position={middle}"]
    keys += ["network.graph=geometric", "consensus.rounds=10", f"sensor.reach={_REACH}", f"steps={steps}"]
    scenario = load("tracking", keys).scenario
    return scenario.changed(network={"radius": _radius(placement(scenario))})


def _radius(places: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """Within which agents at (n, 3) have eight neighbours on average, m: those at the cube's sides have fewer."""
    links = _DEGREE * len(places) // 2
    pairs = pairs_within(places, 2.0 * _SPACING)
    square = np.sum((places[pairs[:, 0]] - places[pairs[:, 1]]) ** 2, axis=1)
    return float(np.sqrt(np.partition(square, links)[links]))


def _peak() -> int:
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def measured(agents: int, steps: int = _STEPS) -> Large:
    """Simulate and analyse so many agents in this process."""
    scenario, started = scenario_of(agents, steps), _peak()
    told = simulation_bytes(Plan(scenario))
    moments = [time.process_time()]
    with np.errstate(all="ignore"):
        [trace] = simulate([scenario], progress=lambda _: moments.append(time.process_time()))
        ended = time.process_time()
        analyze([trace])
    return Large(
        agents,
        2.0 * len(trace.edges) / agents,
        int(np.isfinite(trace.ranges).any(axis=1).sum()),
        moments[1] - moments[0],
        float(np.median(np.diff(moments[1:]))),
        time.process_time() - ended,
        _peak(),
        told,
        started,
    )


def _apart(agents: int) -> Large:
    with children() as family:
        child = family.start("benchmarks.large", [str(agents)], {}, listen_to=True)
        return Large(**json.loads(family.wait(child, _PATIENCE)))


def power(found: list[Large], values: list[float]) -> float:
    """The slope of values over the agents on log-log axes, by least squares."""
    return float(np.polyfit(np.log([one.agents for one in found]), np.log(values), 1)[0])


def _table(found: list[Large]) -> Table:
    columns = ["agents", "neighbours", "hear", "set up (s)", "a step (s)", "analysed (s)", "MB", "MB said beforehand"]
    rows = [
        [
            one.agents,
            one.degree,
            one.hearing,
            one.set_up,
            one.step,
            one.analysis,
            one.memory / 1e6,
            one.beforehand / 1e6,
        ]
        for one in found
    ]
    return plain_table(f"CPU time and largest memory, {_STEPS} steps, L = 10", columns, rows)


def _judged(found: list[Large]) -> Table:
    largest = found[-1].agents
    rows = [
        below(f"{one.agents} agents: CPU time of a step", one.step, _SECONDS, "s")
        for one in found
        if one.agents == 10**5
    ]
    rows += [
        below(f"{one.agents} agents: memory", one.memory / 2**30, _GIBIBYTES, "GiB")
        for one in found
        if one.agents == MILLION
    ]
    for words, values in (
        ("a step", [one.step for one in found]),
        ("memory beyond that of the program", [float(one.memory - one.started) for one in found]),
    ):
        slope = power(found, values)
        rows.append(Row(f"{found[0].agents} to {largest} agents: power by which {words} grows", f"{slope:.3f}"))
    return results("how it grows", rows)


def _panels(folder: Path, found: list[Large]) -> None:
    figure, panels = canvas(2)
    agents = np.array([one.agents for one in found])
    for axes, label, values in (
        (panels[0], "a step (s)", [one.step for one in found]),
        (panels[1], "memory (GB)", [(one.memory - one.started) / 1e9 for one in found]),
    ):
        axes.plot(agents, values, "o-", label="measured")
        axes.plot(agents, values[-1] * agents / agents[-1], "--", color="0.5", label="as the agents")
        axes.set(xlabel="agents", ylabel=label, xscale="log", yscale="log")
    panels[0].legend(frameon=False)
    save(figure, folder, "large")


def run(repeats: int, million: float | None = None, folder: Path = FOLDER) -> Iterator[Table]:
    """1000 agents, ten times and a hundred times as many, and a million where that is asked for; writes the figure."""
    del repeats
    found = [_apart(agents) for agents in (*SIZES, *([MILLION] if million else []))]
    yield _table(found)
    yield _judged(found)
    with mpl.rc_context(STYLE):
        folder.mkdir(parents=True, exist_ok=True)
        _panels(folder, found)


if __name__ == "__main__":
    end_with_parent()
    print(json.dumps(asdict(measured(int(sys.argv[1])))))
