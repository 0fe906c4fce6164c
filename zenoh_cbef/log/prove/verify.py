"""Proof of a log: the run is executed again from its scenario and beacons, and must come out the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from zenoh_cbef.arrays import Bools
from zenoh_cbef.log.prove.comparison import Comparison, Different
from zenoh_cbef.log.read.header import read_header
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.receipts import Receipts
from zenoh_cbef.log.read.recording import Recording, read_recording
from zenoh_cbef.log.read.trace import trace_of
from zenoh_cbef.protocol.kinds import EventMessage
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.plugged import stamped
from zenoh_cbef.simulator import Heard, Simulation
from zenoh_cbef.trace import Trace
from zenoh_cbef.words import counted

_SKEW = 8
"""By how many steps agents' logs may end apart when a run is stopped or its recorder dies."""


@dataclass(frozen=True)
class Verdict:
    """Whether a log is what its scenario gives, in one sentence; compared: how many messages were."""

    result: Literal["equal", "different", "unknown"]
    text: str
    compared: int = 0

    @property
    def exit_status(self) -> int:
        """0 equal, 1 different, 2 cannot be judged."""
        return {"equal": 0, "different": 1, "unknown": 2}[self.result]


class _Due:
    """How many messages each agent should have received from each neighbour, counted as agents count."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._ids, self._links = simulation.neighbours.ids, simulation.neighbours.links
        self._forgotten = np.zeros(simulation.neighbours.present.sum(), dtype=np.int64)

    def step(self, crashed: Bools) -> None:
        """Take in one executed step; crashed: (n,), the agents that will count anew."""
        for agent in np.flatnonzero(crashed).tolist():
            self._forgotten[self._links[agent]] = self._simulation.counts.delivered[self._links[agent]]

    def short(self, agent: int, step: int, receipts: Receipts) -> str:
        """The messages that an agent went on without, as its estimate says; "" where there are none."""
        mine = self._links[agent]
        due = (self._simulation.counts.delivered[mine] - self._forgotten[mine]).tolist()
        told = receipts.told(step)
        received = told.counts["received"] if told else []
        for other, wanted, got in zip(self._ids[agent], due, received, strict=False):
            if got < wanted:
                return f"by step {step} agent {agent} did without {wanted - got} messages from agent {other}"
        return ""


def _doubt(recording: Recording, simulation: Simulation) -> str:
    """Why a log that differs need not be wrong: an agent went on without messages that were due; "" if none did.

    An agent reports that in an event. Where the event did not reach the recorder, the agent's counts show it.
    """
    due = _Due(simulation)
    for number, _ in enumerate(simulation, 1):
        due.step(simulation.absences.crashed(number))
        for agent, receipts in enumerate(recording.receipts):
            if short := due.short(agent, number, receipts):
                return f"{short}, which is not in its scenario"
    told: dict[str, set[int]] = {}
    for event in recording.events:
        told.setdefault(event.message["from"], set()).add(event.message["seq"])
    silenced = [sender for sender, numbers in told.items() if len(numbers) <= max(numbers)]
    if silenced:
        return f"the log differs, but lacks events of {min(silenced)}, which may say why"
    return ""


def verify(path: Path, *, tolerance: float = 0.0, report: Callable[[str], None] = lambda _: None) -> Verdict:
    """Execute the run of a log again and compare. Raises UserError for no log of a run, or other plug-ins.

    report: is told in words how far that is.
    """
    report("reading")
    log = open_log(path)
    header = read_header(log)
    scenario = header.scenario
    stamped(scenario)  # refuses a plug-in that is not the log's
    if scenario.timing.mode == "realtime":
        return Verdict("unknown", "a realtime run depends on when messages came, so it cannot be executed again")
    recording = read_recording(log, header, rounds="payloads")
    steps, doubt = _judgeable(recording)
    if doubt:
        return Verdict("unknown", doubt)
    if recording.damage:
        cut = f"; the log is damaged ({recording.damage[0]}), compared as far as it goes"
    else:
        cut = "" if steps == scenario.length else f"; the run ended at step {steps}"
    return _execute(recording, steps, tolerance, cut, report)


def _judgeable(recording: Recording) -> tuple[int, str]:
    """How many steps can be executed again, and why none can."""
    highest = recording.estimates.last
    if highest == 0:
        return 0, "the log holds no estimate to compare"
    last = np.where(recording.estimates.seen(highest), np.arange(1, highest + 1), 0).max(axis=1)
    last[recording.plan.absences.at(highest)] = highest
    left = int(last.max() - last.min()) > _SKEW
    surprises = [event.message["text"] for event in recording.events if _surprising(event.message, left=left)]
    if surprises:
        return 0, f"{surprises[0]}, which is not in the scenario"
    if left:
        agent = int(np.argmin(last))
        if last[agent] == 0:
            return 0, f"the log holds no estimate of agent {agent}: it never took part, or was left out of this log"
        return 0, f"agent {agent} left after step {last[agent]}, which is not in the scenario"
    lacking = np.flatnonzero(~recording.beacons.seen(highest).all(axis=0))
    steps = int(lacking[0]) if len(lacking) else highest
    if steps < last.min():
        return 0, f"the log lacks beacons of step {steps + 1}, without which the run cannot be executed again"
    return steps, ""


def _surprising(event: EventMessage, *, left: bool) -> bool:
    """Whether something happened that lockstep does not know: an agent did without messages, or came unasked.

    left: an agent left, which says more than that others then did without its messages.
    """
    unasked = event["kind"] == "joined" and not event.get("data", {}).get("planned")
    return bool(event["kind"] == "silent" or (event["kind"] == "missed" and not left) or unasked)


def _simulation(trace: Trace, steps: int) -> Simulation:
    """The run of a log, to be executed again on what the log says was measured."""
    scenario = trace.scenario.changed(steps=steps)
    # What is plausible depends on how long the run was to be, not on where it was stopped.
    return Simulation(
        [Plan(scenario)], [Heard(trace.positions[:, :steps], trace.ranges[:, :steps], trace.age[:, :steps])]
    )


def _execute(recording: Recording, steps: int, tolerance: float, cut: str, report: Callable[[str], None]) -> Verdict:
    trace = trace_of(recording)
    simulation = _simulation(trace, steps)
    comparison = Comparison(recording, trace, simulation, tolerance)
    try:
        for number, step in enumerate(simulation, 1):
            comparison.step(number, step)
            report(f"step {number} of {steps} executed again")
    except Different as difference:
        if doubt := _doubt(recording, _simulation(trace, steps)):
            return Verdict("unknown", doubt, comparison.compared)
        return Verdict("different", f"different: {difference}", comparison.compared)
    if comparison.unlogged:
        cut += f"; {comparison.unlogged} more are not in the log"
    how = "bit for bit" if comparison.largest == 0.0 else f"within {comparison.largest:.1e}"
    return Verdict(
        "equal",
        f"equal {how}: {counted(comparison.compared, 'message')} of {counted(steps, 'step')}{cut}",
        comparison.compared,
    )
