"""A log's measurements through another filter, without processes: the result is a log of the same kind."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from platform import node as host_name

import numpy as np

from zenoh_cbef import __version__
from zenoh_cbef.arrays import Floats
from zenoh_cbef.log.read.measurements import Measurements
from zenoh_cbef.log.write.computed_run import ComputedRun
from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.protocol.fields import END, START
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import Loaded, to_toml
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import Simulation, Step, heard_in

ORIGIN = "reestimated"
"""Key of a log's metadata that names the run whose measurements it is of."""


@dataclass(frozen=True)
class Reestimated:
    """What was done: steps; how long the run was in its own time, and how long it took to compute and to write, s."""

    steps: int
    run_seconds: float
    computing_seconds: float
    writing_seconds: float


def reestimate(
    found: Measurements,
    loaded: Loaded,
    run: str,
    output: Path,
    progress: Callable[[int], None] = lambda _: None,
) -> Reestimated:
    """Estimate again from what was measured, and write the log of a run of that name; it must not exist yet.

    loaded: from `Measurements.loaded`; messages arrive as in lockstep. Raises UserError where the filter diverges or
    the log cannot be written.
    """
    scenario = _in_lockstep(loaded.scenario)
    plan = Plan(scenario)
    world = found.world(scenario)
    simulation = Simulation([plan], [heard_in(plan, world)])
    log = RunLog(output, scenario.record)
    try:
        log.describe(source=loaded.source, resolved=to_toml(scenario), run=_description(found, scenario, run))
        writer = _Writer(found, ComputedRun(log, run, plan, simulation.neighbours), Keys(run), plan)
        began, writing = time.perf_counter(), 0.0
        for number, step in enumerate(simulation, 1):
            computed = time.perf_counter()
            writer.step(number, step, world.positions[:, number - 1])
            writing += time.perf_counter() - computed
            progress(number)
        writer.end()
        computing = time.perf_counter() - began - writing
        log.close({"status": "finished", "run": run, "log": str(output), "messages": str(log.count)})
    except BaseException:
        log.abandon()
        log.active.unlink(missing_ok=True)
        raise
    return Reestimated(scenario.length, scenario.length * scenario.dt, computing, writing)


def _in_lockstep(scenario: Scenario) -> Scenario:
    return scenario.changed(timing={"mode": "lockstep"})


def _description(found: Measurements, scenario: Scenario, run: str) -> dict[str, str]:
    return {
        "run": run,
        "name": scenario.name,
        "seed": str(scenario.seed),
        "version": __version__,
        "host": host_name(),
        "started": datetime.now(UTC).isoformat(),
        ORIGIN: found.header.run,
    }


class _Writer:
    """Target and agents by the clock of the original: a step is as long as from its beacons to the next ones."""

    def __init__(self, found: Measurements, computed: ComputedRun, keys: Keys, plan: Plan) -> None:
        self._found, self._computed, self._keys, self._scenario = found, computed, keys, plan.scenario
        self._pace = round(1e9 * plan.scenario.dt)
        at = found.logged.get(1, 0) / 1e9 if found.start is None else found.start
        began = {"kind": "started", "text": f"run {keys.run} started", "data": {"at": at}}
        self._computed.say("target", keys.event("target"), self._moment(0), began)
        self._absences, self._at = plan.absences, at
        self._signal(range(plan.scenario.count), 0, START, at=at)

    def step(self, number: int, step: Step, positions: Floats) -> None:
        """The truth and beacons of a step, and all that the agents make of it."""
        moment = self._moment(number)
        self._signal(np.flatnonzero(self._absences.reborn(number)).tolist(), number - 1, START, at=self._at)
        truth = self._found.truth(number)
        if truth is not None:
            self._computed.say("target", self._keys.truth, moment, truth)
        for agent in range(self._scenario.count):
            sender, body = self._found.beacon(agent, number)
            self._computed.say(sender, self._keys.beacon(agent), moment, body)
        self._computed.step(number, positions, step, moment, self._moment(number + 1))

    def end(self) -> None:
        """The signal to end, and last words."""
        self._signal(range(self._scenario.count), self._scenario.length + 1, END)
        self._computed.end(self._scenario.length)

    def _signal(self, agents: Iterable[int], number: int, signal: str, **more: float) -> None:
        body = {"k": number, "signal": signal, **more}
        for agent in agents:
            self._computed.say("target", self._keys.signal(agent), self._moment(number), body)

    def _moment(self, number: int) -> int:
        """When a step began (ns); where the original does not say, one step from where it does."""
        logged = self._found.logged
        if number in logged:
            return logged[number]
        nearest = min(logged, key=lambda known: abs(known - number))
        return logged[nearest] + (number - nearest) * self._pace
