"""The same tracker without processes: runs that differ only in their seed are one batch."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.faults import Fate, Fates
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.build import batch_parts, fates_of, outgoing_of, smoother_of
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.plausible import taken
from zenoh_cbef.scenario.size import refuse_a_trace_beyond_memory
from zenoh_cbef.scenario.world import World, make_world
from zenoh_cbef.trace import LinkCounts, Links, SmoothedPath, Trace, Traffic
from zenoh_cbef.tracking.diagnostics import NAMES, Diagnostics
from zenoh_cbef.tracking.filters.rows import chosen
from zenoh_cbef.tracking.graph import Neighbours
from zenoh_cbef.tracking.newcomer import belief_from
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours
from zenoh_cbef.tracking.smoothing import Smoothed
from zenoh_cbef.tracking.tracker import Estimate

_BLOCK, _PART = 1080, 360
"""Agents of one batch of runs, and of one part of a larger run: data of a round that a core's own cache holds."""


@dataclass(frozen=True)
class Heard:
    """What the receivers of all rows measured in steps 1 to K: positions (N, K, 3), ranges and ages (N, K)."""

    positions: Floats
    ranges: Floats
    age: Floats


@dataclass(frozen=True)
class Step:
    """One simulated step: the messages sent in every round (L, N, d), the estimates, and smoothed ones that are due.

    told: (N,), ranges as they were sent to neighbours, m. fates: of the messages that were to be used, round by round,
    over the present neighbours of all rows in order; none where no fault touches any link. absent: (N,), the agents
    that were not there; their rows of `sent` and `estimate` have no meaning.
    """

    sent: list[Floats]
    estimate: Estimate
    told: Floats
    fates: list[Fate]
    absent: Bools
    smoothed: list[Smoothed]


def measured(plan: Plan, emitted: Floats, arrived: Floats, step: int | Floats) -> tuple[Floats, Floats]:
    """Range (m) and age (s) that agents take from beacon times; NaN where none is plausible and tells a distance."""
    with np.errstate(over="ignore", invalid="ignore"):  # times can be forged
        ranges, age = taken(plan.scenario, emitted, arrived, step)
    holds = plan.plausible.holds(ranges, age) & plan.plausible.tells(ranges)
    return np.where(holds, ranges, np.nan), np.where(holds, age, np.nan)


def heard_in(plan: Plan, world: World) -> Heard:
    """What one world's receivers measured."""
    steps = np.arange(1, plan.scenario.length + 1, dtype=np.float64)
    ranges, age = measured(plan, world.emitted, world.arrived, steps)
    return Heard(world.positions, ranges, np.where(np.isfinite(age), age, 0.0))


def _together(runs: Sequence[Heard]) -> Heard:
    """The rows of all runs."""
    if len(runs) == 1:
        return runs[0]
    return Heard(*(np.concatenate([getattr(one, name) for one in runs]) for name in vars(runs[0])))


def _all_fates(plans: Sequence[Plan], neighbours: Neighbours) -> Fates:
    count = plans[0].scenario.count
    rows, _ = np.nonzero(neighbours.present)
    seeds = np.array([one.scenario.seed for one in plans], dtype=np.uint64)[rows // count]
    source = (neighbours.index[neighbours.present] % count).astype(np.int64)
    return fates_of(plans[0], seeds, source, (rows % count).astype(np.int64))


class Simulation:
    """A batch of runs, step by step. keeps_sent: whether a `Step` has the messages; they take memory."""

    def __init__(self, plans: Sequence[Plan], heard: Sequence[Heard], *, keeps_sent: bool = True) -> None:
        self.plan, self.scenario = plans[0], plans[0].scenario
        self.rounds, self._keeps_sent = self.plan.rounds, keeps_sent or self.scenario.consensus.lag > 0
        self.heard = _together(heard)
        hears = np.asarray(np.isfinite(self.heard.ranges).any(axis=1))
        self.tracker, self.neighbours = batch_parts(plans, _BLOCK if self.scenario.count <= _PART else _PART, hears)
        self.counts = LinkCounts(self.neighbours.present)
        self._fates = _all_fates(plans, self.neighbours)
        self._outgoing = outgoing_of(plans, range(self.scenario.count))
        self.absences, self._runs = self.plan.absences, len(plans)
        self._initial = self.tracker.belief
        self._estimate: Estimate | None = None
        self._sent: deque[list[Floats]] = deque(maxlen=1 + self.scenario.consensus.lag)
        self._agents = np.tile(np.arange(self.scenario.count), len(plans))
        self._links = np.flatnonzero(self.neighbours.present)
        self._noted, self.smoother = list[Fate](), smoother_of(self.plan)

    def __iter__(self) -> Iterator[Step]:
        for step in range(1, self.scenario.length + 1):
            yield self._step(step)

    def _delivered(self, step: int, round_: int) -> Bools | None:
        """Which messages are delivered, (n, m); None for all."""
        present = self.neighbours.present
        self.counts.sent()
        if self._fates.quiet:
            return None
        fate = self._fates.of(step, round_)
        self.counts.add(fate)
        self._noted.append(fate)
        due = np.zeros(present.size, dtype=bool)
        due[self._links] = fate.due
        return due.reshape(present.shape)

    def _measurement(self, step: int, told: Floats) -> Measurement:
        position, range_, age = (
            part[:, step - 1] for part in (self.heard.positions, self.heard.ranges, self.heard.age)
        )
        if not self.plan.sharing.uses_neighbour_ranges:
            return Measurement(position, range_, age, *no_neighbours(len(position)), step=step, agent=self._agents)
        index, delivered = self.neighbours.index, self._delivered(step, 0)
        delivered = self.neighbours.present if delivered is None else delivered
        return Measurement(
            position,
            range_,
            age,
            np.where(delivered[:, :, None], position[index], 0.0),
            np.where(delivered, told[index], np.nan),
            step=step,
            agent=self._agents,
        )

    def _welcome(self, step: int) -> None:
        """Agents that come back without a memory begin with the estimates of those neighbours that they can ask."""
        reborn = np.tile(self.absences.reborn(step), self._runs)
        if self._estimate is None or not reborn.any():
            return
        present, index = self.neighbours.present, self.neighbours.index
        told = np.zeros_like(present)
        told[present] = self._fates.reaches(step)
        told &= ~np.tile(self.absences.at(step - 1), self._runs)[index]
        known, covariance = self._estimate.state[index], self._estimate.covariance
        covariance = None if covariance is None else covariance[index]
        belief = belief_from(self.tracker.space, known, covariance, told, self._initial)
        alone = reborn & ~told.any(axis=1)
        if alone.any():
            belief = chosen(belief, self.plan.guessed_at(self._initial, step - 1), alone)
        self.tracker.adopt(belief, reborn)

    @np.errstate(all="ignore")  # liars' messages can make a tracker overflow, which looks at its results
    def _step(self, step: int) -> Step:
        self._noted = []
        self._welcome(step)
        told = self._outgoing.ranges(step, self.heard.ranges[:, step - 1])
        message = self.tracker.measure(self._measurement(step, told))
        sent: list[Floats] = []
        self._sent.append(sent)
        used = step - self.scenario.consensus.lag
        for round_ in range(1, self.rounds + 1):
            message = self._outgoing.message(step, round_, message)
            if self._keeps_sent:
                sent.append(message)
                message = self._sent[0][round_ - 1]
            delivered = self._delivered(used, round_) if used >= 1 else np.zeros_like(self.neighbours.present)
            message = self.tracker.exchange(message, delivered)
        estimate = self._estimate = self.tracker.conclude()
        absent = np.tile(self.absences.at(step), self._runs)
        return Step(sent, estimate, told, self._noted, absent, self._smoothed(step))

    def _smoothed(self, step: int) -> list[Smoothed]:
        """The smoothed estimates that are due, at the end all; agents that come back without a memory begin anew."""
        if self.smoother is None:
            return []
        self.smoother.take(step, self.tracker.belief, np.tile(self.absences.reborn(step), self._runs))
        return self.smoother.due(last=step == self.scenario.length)


def simulate(
    scenarios: Sequence[Scenario],
    *,
    heard: Sequence[Heard] | None = None,
    keep_payloads: bool = False,
    progress: Callable[[int], None] | None = None,
) -> list[Trace]:
    """Simulate runs that differ only in their seed; bit for bit what processes compute in lockstep.

    heard: measurements in place of the emulated ones. progress is called with each finished step.
    """
    plans = [first := Plan(scenarios[0]), *(Plan(one, first) for one in scenarios[1:])]
    refuse_a_trace_beyond_memory(plans[0], len(plans))
    worlds = [make_world(one) for one in scenarios]
    heard = heard or [heard_in(one, world) for one, world in zip(plans, worlds, strict=True)]
    size = max(1, _BLOCK // scenarios[0].count)
    blocks = range(0, len(scenarios), size)
    traces: list[Trace] = []
    for done, start in enumerate(blocks):
        mine = slice(start, start + size)

        def advance(step: int, done: int = done) -> None:
            if progress is not None:
                progress((done * scenarios[0].length + step) // len(blocks))

        traces += _simulate_block(plans[mine], worlds[mine], heard[mine], advance, keep_payloads=keep_payloads)
    return traces


def _simulate_block(
    plans: Sequence[Plan],
    worlds: Sequence[World],
    heard: Sequence[Heard],
    progress: Callable[[int], None],
    *,
    keep_payloads: bool,
) -> list[Trace]:
    simulation = Simulation(plans, heard, keeps_sent=keep_payloads)
    results = _Results(simulation)
    for k, step in enumerate(simulation):
        results.put(k, step, keep_payloads=keep_payloads)
        progress(k + 1)
    count = simulation.scenario.count
    return [
        results.trace(one, worlds[run], heard[run], slice(run * count, (run + 1) * count))
        for run, one in enumerate(plans)
    ]


class _Results:
    """The estimates of all rows, as a trace holds them."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._shape = rows, steps = len(simulation.neighbours.index), simulation.scenario.length
        self.estimates = np.empty((rows, steps, 6))
        self.covariances = np.empty((rows, steps, 6, 6))
        self.said = np.empty((rows, steps, len(NAMES)))
        self.payloads: Floats | None = None
        self.smoothed = SmoothedPath.empty(rows, steps, lag) if (lag := simulation.plan.smoothing_lag) else None

    def put(self, k: int, step: Step, *, keep_payloads: bool) -> None:
        """Take in step k + 1."""
        estimate = step.estimate
        self.estimates[:, k] = estimate.state
        self.covariances[:, k] = np.nan if estimate.covariance is None else estimate.covariance
        self.said[:, k] = np.stack(list(estimate.diagnostics.named().values()), axis=1)
        if keep_payloads and step.sent:
            if self.payloads is None:
                self.payloads = np.empty((*self._shape, len(step.sent), step.sent[0].shape[1]))
            self.payloads[:, k] = np.stack(step.sent, axis=1)
        if self.smoothed is not None:
            self.smoothed.put(step.smoothed, step.absent)
        if step.absent.any():
            self._leave_out(k, step.absent)

    def _leave_out(self, k: int, absent: Bools) -> None:
        """Write NaN for agents that are not there."""
        for values in (self.estimates, self.covariances, self.said, self.payloads):
            if values is not None:
                values[absent, k] = np.nan

    def trace(self, plan: Plan, world: World, heard: Heard, mine: slice) -> Trace:
        """The rows of one run."""
        links = _links(self._simulation, mine)
        upward = links.destination < links.source
        return Trace(
            name=plan.scenario.name,
            plan=plan,
            time=world.time,
            truth=world.truth,
            positions=heard.positions,
            ranges=heard.ranges,
            age=heard.age,
            initial=plan.initial_states,
            estimates=self.estimates[mine],
            covariances=self.covariances[mine],
            diagnostics=Diagnostics.read(self.said[mine]),
            edges=np.stack([links.destination[upward], links.source[upward]], axis=1),
            links=links,
            traffic=Traffic(0, 0, 0, 0),
            payloads=None if self.payloads is None else self.payloads[mine],
            smoothed=None if self.smoothed is None else self.smoothed.of(mine),
        )


def _links(simulation: Simulation, mine: slice) -> Links:
    neighbours = simulation.neighbours
    present = neighbours.present[mine]
    source = (neighbours.index[mine][present] - mine.start).astype(np.int64)
    destination = np.repeat(np.arange(len(present)), present.sum(axis=1)).astype(np.int64)
    return simulation.counts.links(mine, source, destination)
