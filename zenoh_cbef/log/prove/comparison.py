"""Logged messages beside executed ones, bit for bit or within a tolerance."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.faults.injected import FATES, Injected, Told
from zenoh_cbef.log.read.receipts import INJECTED, Receipt
from zenoh_cbef.log.read.recording import Recording
from zenoh_cbef.simulator import Simulation, Step
from zenoh_cbef.trace import SmoothedPath, Trace
from zenoh_cbef.tracking.diagnostics import NAMES, SOMETIMES, Numbers
from zenoh_cbef.tracking.graph import Neighbours


class Different(Exception):
    """The first difference."""


class _Faults:
    """Compares what agents say that faults did to their neighbours' messages with what the scenario says."""

    def __init__(self, neighbours: Neighbours) -> None:
        self._injected, self._links = Injected(int(neighbours.present.sum())), neighbours.links
        self._told = Told({}, [])

    def step(self, step: Step, crashed: Bools) -> None:
        """Take in the fates of one executed step; crashed: (n,), the agents that will count anew."""
        for fate in step.fates:
            self._injected.note(fate)
        for agent in np.flatnonzero(crashed).tolist():
            self._injected.forget(self._links[agent])
        self._told = self._injected.take()

    def compare(self, at: str, agent: int, said: Receipt) -> None:
        """Compare what an agent's estimate of that step says. Raises Different."""
        message: dict[str, object] = {**said.counts, **({} if said.marks is None else {FATES: said.marks})}
        names = (*self._told.counts, FATES)
        if message.keys().isdisjoint(names):
            return  # No fault is on the agent's links, or the log is of version 0.1.0.
        executed = self._told.of(self._links[agent]).fields()
        for name in names:
            if message.get(name) != executed.get(name):
                raise Different(f"{at}{name} is {message.get(name)} in the log and {executed.get(name)} when executed")


class Comparison:
    """Compares a run's estimates and consensus messages with executed ones.

    compared: how many there were so far. unlogged: how many more were executed. largest: relative difference so far.
    """

    def __init__(self, recording: Recording, trace: Trace, simulation: Simulation, tolerance: float) -> None:
        self._trace, self._receipts, self._tolerance = trace, recording.receipts, tolerance
        self._absences, self._faults = simulation.absences, _Faults(simulation.neighbours)
        # Without faults on any link, and in logs of version 0.1.0, agents say nothing of them.
        self._faulty = not recording.fields.isdisjoint((*INJECTED, FATES))
        count, steps = trace.ranges.shape
        shape = count, recording.rounds_per_step, steps
        self._estimated = recording.estimates.seen(steps)
        self._sent = recording.rounds.seen(steps).reshape(shape)
        payloads = recording.rounds.numbers("payload", steps)
        self._payloads = payloads.reshape(*shape, payloads.shape[-1])
        # Logs of version 0.1.0 lack most diagnostics; of others an estimate lacks those that have nothing to say.
        self._names = [name for name in NAMES if name in recording.fields or name in SOMETIMES]
        self._said = self._columns(vars(trace.diagnostics))
        self._smoother, self._smoothed = simulation.smoother, _by_latest(recording, steps)
        self._paths = trace.smoothed or SmoothedPath.empty(0, 0, 0)
        self.compared = self.unlogged = 0
        self.largest = 0.0

    def step(self, number: int, step: Step) -> None:
        """Compare one step of all agents. Raises Different."""
        self._faults.step(step, self._absences.crashed(number))
        for round_, sent in enumerate(step.sent, 1):
            seen, logged = self._sent[:, round_ - 1, number - 1], self._payloads[:, round_ - 1, number - 1]
            self._count(seen, step.absent)
            if not _equal(logged[seen], sent[seen]):
                for agent in np.flatnonzero(seen).tolist():
                    self._same(f"agent {agent}, step {number}, round {round_}: payload", logged[agent], sent[agent])
        seen = self._estimated[:, number - 1]
        self._count(seen, step.absent)
        executed = self._columns(vars(step.estimate.diagnostics))
        for agent in np.flatnonzero(seen).tolist():
            self._estimate(agent, number, step, executed[agent])
        self._compare_smoothed(number, step)

    def _columns(self, diagnostics: Mapping[str, Numbers]) -> Floats:
        return np.stack([diagnostics[name].astype(np.float64) for name in self._names], axis=-1)

    def _count(self, logged: Bools, absent: Bools) -> None:
        self.compared += int(logged.sum())
        self.unlogged += int((~logged & ~absent).sum())

    def _estimate(self, agent: int, number: int, step: Step, executed: Floats) -> None:
        at, place = f"agent {agent}, step {number}: ", (agent, number - 1)
        receipt = self._receipts[agent].told(number)
        if receipt is None:
            raise Different(at + "its counts are not of its neighbours, one each")
        if self._faulty:
            self._faults.compare(at, agent, receipt)
        self._same(at + "state", self._trace.estimates[place], step.estimate.state[agent])
        said = self._said[place]
        if not _equal(said, executed):
            for name, logged, own in zip(self._names, said, executed, strict=True):
                self._same(at + name, logged, own)
        logged, covariance = self._trace.covariances[place], step.estimate.covariance
        if covariance is None or not _equal(logged, covariance[agent]):
            if np.isnan(logged).all() != (covariance is None):
                raise Different(at + "covariance is there in one only")
            if covariance is not None:
                self._same(at + "covariance", logged, covariance[agent])

    def _compare_smoothed(self, number: int, step: Step) -> None:
        """Compare the smoothed estimates of which this step is the latest: an agent's last ones have a shorter lag."""
        logged = self._smoothed.pop(number, {})
        due = sum(int((one.known & ~step.absent).sum()) for one in step.smoothed)
        self.unlogged += max(0, due - sum(map(len, logged.values())))
        if not logged:
            return
        for one in () if self._smoother is None else self._smoother.back():
            for agent in logged.pop(one.step, ()):
                at, place = f"agent {agent}, step {one.step}, smoothed up to {number}: ", (agent, one.step - 1)
                self._same(at + "state", self._paths.states[place], one.state[agent])
                self._same(at + "covariance", self._paths.covariances[place], one.covariance[agent])
                self.compared += 1
        if logged:
            raise Different(f"step {min(logged)}, smoothed up to {number}: no agent does that when executed")

    def _same(self, what: str, logged: Floats, executed: Floats) -> None:
        logged, executed = np.ascontiguousarray(logged), np.ascontiguousarray(executed)
        if _equal(logged, executed):
            return
        both_nan = np.isnan(logged) & np.isnan(executed)
        scale = np.maximum(np.maximum(np.abs(logged), np.abs(executed)), 1.0)
        apart = np.where(both_nan, 0.0, np.abs(logged - executed) / scale)
        if both_nan.all() or (np.isfinite(apart).all() and 0.0 < self._tolerance >= apart.max()):
            self.largest = max(self.largest, float(apart.max()))
            return
        first = int(np.argmax(logged.view(np.uint64).ravel() != executed.view(np.uint64).ravel()))
        raise Different(
            f"{what}[{first}] is {logged.item(first)!r} in the log and {executed.item(first)!r} when executed"
        )


def _by_latest(recording: Recording, steps: int) -> dict[int, dict[int, list[int]]]:
    """The agents whose smoothed estimates are in the log, by the latest step in it and by the step it is of."""
    found: dict[int, dict[int, list[int]]] = {}
    agents, places = np.nonzero(recording.smoothed.seen(steps))
    latest = recording.smoothed.numbers("until", steps)[agents, places, 0].astype(np.int64)
    for agent, place, until in zip(agents.tolist(), places.tolist(), latest.tolist(), strict=True):
        found.setdefault(until, {}).setdefault(place + 1, []).append(agent)
    return found


def _equal(logged: Floats, executed: Floats) -> bool:
    return logged.tobytes() == executed.tobytes()
