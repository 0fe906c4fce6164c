"""Proof of a log: the run is executed again from its scenario and beacons, and must come out the same."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.faults.injected import FATES, IN_TIME, Injected
from zenoh_cbef.log.read.contents import Contents, Header, read_contents, read_header
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.trace import heard_ranges, logged_positions
from zenoh_cbef.protocol.messages import BadMessage, nil_to_nan, unpack_floats
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import Heard, Simulation, Step
from zenoh_cbef.tracking.diagnostics import SOMETIMES
from zenoh_cbef.words import counted

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

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


class _Different(Exception):
    """The first difference."""


class _Faults:
    """Compares what agents say that faults did to their neighbours' messages with what the scenario says."""

    def __init__(self, present: Bools) -> None:
        self._injected = Injected(int(present.sum()))
        ends = np.cumsum(present.sum(axis=1)).tolist()
        self._links = [slice(start, end) for start, end in pairwise([0, *ends])]
        self._told: dict[str, list[Any]] = {}

    def step(self, step: Step, crashed: Bools) -> None:
        """Take in the fates of one executed step; crashed: (n,), the agents that will count anew."""
        for fate in step.fates:
            self._injected.note(fate)
        for agent in np.flatnonzero(crashed).tolist():
            self._injected.forget(self._links[agent])
        self._told = self._injected.take()

    def compare(self, at: str, agent: int, message: dict[str, Any]) -> None:
        """Compare an agent's estimate of that step. Raises _Different."""
        executed = {name: values[self._links[agent]] for name, values in self._told.items()}
        if executed.keys().isdisjoint(message):
            return  # No fault is on the agent's links, or the log is of version 0.1.0.
        if not any(marks.strip(IN_TIME) for marks in executed.get(FATES, [])):
            executed.pop(FATES, None)
        for name in (*self._told, FATES):
            if message.get(name) != executed.get(name):
                raise _Different(f"{at}{name} is {message.get(name)} in the log and {executed.get(name)} when executed")


class _Comparison:
    """Compares logged messages with executed ones, bit for bit or within a relative tolerance."""

    def __init__(self, contents: Contents, simulation: Simulation, tolerance: float) -> None:
        self._contents, self._tolerance = contents, tolerance
        self._absences, self._faults = simulation.absences, _Faults(simulation.neighbours.present)
        self.compared = 0
        self.unlogged = 0
        self.largest = 0.0

    def step(self, number: int, step: Step) -> None:
        """Compare one step of all agents. Raises _Different."""
        self._faults.step(step, self._absences.crashed(number))
        for round_, sent in enumerate(step.sent, 1):
            for agent, payload in enumerate(sent):
                logged = self._contents.rounds.get((agent, number, round_))
                self._count(logged, there=not step.absent[agent])
                if logged is not None:
                    self._same(f"agent {agent}, step {number}, round {round_}: payload", logged, payload)
        for agent in range(len(step.estimate.state)):
            message = self._contents.estimates.get((agent, number))
            self._count(message, there=not step.absent[agent])
            if message is not None:
                self._estimate(agent, number, message, step)

    def _count(self, logged: object, *, there: bool) -> None:
        self.compared += logged is not None
        self.unlogged += logged is None and there

    def _estimate(self, agent: int, number: int, message: dict[str, Any], step: Step) -> None:
        at = f"agent {agent}, step {number}: "
        estimate = step.estimate
        self._faults.compare(at, agent, message)
        self._same(at + "state", np.array(message["state"]), estimate.state[agent])
        for name, value in estimate.diagnostics.named().items():
            if name not in message and name not in SOMETIMES:
                continue  # A log of version 0.1.0.
            logged = message.get(name)
            number_ = nil_to_nan(float(logged) if isinstance(logged, float | int) else None)
            self._same(at + name, np.array([number_]), value[agent : agent + 1].astype(np.float64))
        packed = message["covariance"]
        if (packed is None) != (estimate.covariance is None):
            raise _Different(at + "covariance is there in one only")
        if isinstance(packed, bytes) and estimate.covariance is not None:
            try:
                covariance = unpack_floats(packed, 6, 6)
            except BadMessage as error:
                raise _Different(f"{at}covariance has {error}") from None
            self._same(at + "covariance", covariance, estimate.covariance[agent])

    def _same(self, what: str, logged: Floats, executed: Floats) -> None:
        logged = np.ascontiguousarray(logged, dtype=np.float64)
        executed = np.ascontiguousarray(executed)
        if logged.tobytes() == executed.tobytes():
            return
        both_nan = np.isnan(logged) & np.isnan(executed)
        scale = np.maximum(np.maximum(np.abs(logged), np.abs(executed)), 1.0)
        apart = np.where(both_nan, 0.0, np.abs(logged - executed) / scale)
        if both_nan.all() or (np.isfinite(apart).all() and 0.0 < self._tolerance >= apart.max()):
            self.largest = max(self.largest, float(apart.max()))
            return
        first = int(np.argmax(logged.view(np.uint64).ravel() != executed.view(np.uint64).ravel()))
        raise _Different(
            f"{what}[{first}] is {logged.ravel()[first]!r} in the log and {executed.ravel()[first]!r} when executed"
        )


class _Receipts:
    """How many messages each agent should have received from each neighbour, counted as agents count."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        present = simulation.neighbours.present
        self._ids = [row[there].tolist() for row, there in zip(simulation.neighbours.index, present, strict=True)]
        ends = np.cumsum(present.sum(axis=1)).tolist()
        self._links = [slice(start, end) for start, end in pairwise([0, *ends])]
        self._forgotten = np.zeros(present.sum(), dtype=np.int64)

    def step(self, crashed: Bools) -> None:
        """Take in one executed step; crashed: (n,), the agents that will count anew."""
        for agent in np.flatnonzero(crashed).tolist():
            self._forgotten[self._links[agent]] = self._simulation.counts.delivered[self._links[agent]]

    def short(self, agent: int, message: dict[str, Any]) -> str:
        """Which messages an agent did without, as it says in its estimate; "" where it is none."""
        mine = self._links[agent]
        due = (self._simulation.counts.delivered[mine] - self._forgotten[mine]).tolist()
        for other, wanted, got in zip(self._ids[agent], due, message["received"], strict=False):
            if got < wanted:
                return f"by step {message['k']} agent {agent} did without {wanted - got} messages from agent {other}"
        return ""


def _doubt(header: Header, contents: Contents, steps: int) -> str:
    """Why a log that differs need not be wrong: an agent did without messages that were due; "" where it is so.

    An agent says that in an event. Where that did not reach the recorder, its counts show it.
    """
    simulation = _simulation(header, contents, steps)
    receipts = _Receipts(simulation)
    for number, _ in enumerate(simulation, 1):
        receipts.step(simulation.absences.crashed(number))
        for agent in range(header.scenario.count):
            message = contents.estimates.get((agent, number))
            if message is not None and (short := receipts.short(agent, message)):
                return f"{short}, which no scenario foretells"
    told: dict[str, set[int]] = {}
    for event in contents.events:
        told.setdefault(event["from"], set()).add(event["seq"])
    silenced = [sender for sender, numbers in told.items() if len(numbers) <= max(numbers)]
    if silenced:
        return f"the log differs, but lacks events of {min(silenced)}, which may say why"
    return ""


def verify(path: Path, *, tolerance: float = 0.0) -> Verdict:
    """Execute the run of a log again and compare. Raises UserError where the file is no log of a run."""
    file = open_log(path)
    header = read_header(file, path)
    if header.scenario.timing.mode == "realtime":
        return Verdict("unknown", "a realtime run depends on when messages came, so it cannot be executed again")
    contents = read_contents(file, header)
    steps, doubt = _judgeable(header, contents)
    if doubt:
        return Verdict("unknown", doubt)
    if file.damage:
        cut = f"; the log is damaged ({file.damage[0]}), compared as far as it goes"
    else:
        cut = "" if steps == header.scenario.length else f"; the run ended at step {steps}"
    return _execute(header, contents, steps, tolerance, cut)


def _judgeable(header: Header, contents: Contents) -> tuple[int, str]:
    """How many steps can be executed again, and why none can."""
    count = header.scenario.count
    last = [0] * count
    for agent, step in contents.estimates:
        last[agent] = max(last[agent], step)
    if max(last) == 0:
        return 0, "the log holds no estimate to compare"
    absent = header.plan.absences.at(max(last))
    last = [max(last) if away else step for step, away in zip(last, absent.tolist(), strict=True)]
    left = max(last) - min(last) > _SKEW
    surprises = [event["text"] for event in contents.events if _surprising(event, left=left)]
    if surprises:
        return 0, f"{surprises[0]}, which no scenario foretells"
    if left:
        agent = int(np.argmin(last))
        if last[agent] == 0:
            return 0, f"the log holds no estimate of agent {agent}: it never took part, or was left out of this log"
        return 0, f"agent {agent} left after step {last[agent]}, which no scenario foretells"
    steps = 0
    while steps < max(last) and all((agent, steps + 1) in contents.beacons for agent in range(count)):
        steps += 1
    if steps < min(last):
        return 0, f"the log lacks beacons of step {steps + 1}, without which the run cannot be executed again"
    return steps, ""


def _surprising(event: dict[str, Any], *, left: bool) -> bool:
    """Whether something happened that lockstep does not know: an agent did without messages, or came unasked.

    left: an agent left, which says more than that others then did without its messages.
    """
    unasked = event["kind"] == "joined" and not event.get("data", {}).get("planned")
    return bool(event["kind"] == "silent" or (event["kind"] == "missed" and not left) or unasked)


def _simulation(header: Header, contents: Contents, steps: int) -> Simulation:
    """The run of a log, to be executed again."""
    scenario = header.scenario.model_copy(update={"steps": steps})
    # What is plausible depends on how long the run was to be, not on where it was stopped.
    ranges, age = heard_ranges(header.plan, contents, steps)
    return Simulation([Plan(scenario)], [Heard(logged_positions(scenario, contents, steps), ranges, age)])


def _execute(header: Header, contents: Contents, steps: int, tolerance: float, cut: str) -> Verdict:
    simulation = _simulation(header, contents, steps)
    comparison = _Comparison(contents, simulation, tolerance)
    try:
        for number, step in enumerate(simulation, 1):
            comparison.step(number, step)
    except _Different as difference:
        if doubt := _doubt(header, contents, steps):
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
