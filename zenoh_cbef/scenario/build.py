"""Makes what a plan needs to run: trackers, fates of messages, faults of senders; for one agent or a batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats, Ids
from zenoh_cbef.faults import Fates, Outgoing
from zenoh_cbef.scenario import network
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking import graph
from zenoh_cbef.tracking.backwards import Backwards, OneMotion, SeveralMotions
from zenoh_cbef.tracking.consensus import Average, Chebyshev, Consensus, Rounding, RunningSums, Workspace
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.isolating import Isolating
from zenoh_cbef.tracking.knowable import most_information
from zenoh_cbef.tracking.links import Links
from zenoh_cbef.tracking.motion import LinearMotion
from zenoh_cbef.tracking.parts import Part, Parts
from zenoh_cbef.tracking.payloads import InformationPayloads
from zenoh_cbef.tracking.smoothing import FixedLag
from zenoh_cbef.tracking.stale import StaleAverage
from zenoh_cbef.tracking.tracker import Tracker
from zenoh_cbef.tracking.triggered import Triggered
from zenoh_cbef.tracking.trimmed import TrimmedComponents, TrimmedMessages

Seeds = NDArray[np.uint64]


def _rounded(plan: Plan) -> Rounding | None:
    """What receivers take messages to be; None where these are in all their bits."""
    return None if plan.compact is None else plan.compact.rounded


def _linked(plan: Plan) -> bool:
    """Whether a batch's consensus stage takes what all agents sent: where it treats all neighbours alike."""
    stage = plan.scenario.consensus
    return not (stage.lag or stage.trim or stage.trigger or plan.isolates)


def _stage(
    plan: Plan,
    present: Bools,
    weights: Floats,
    bounds: Floats,
    *,
    workspace: Workspace | None = None,
    links: Links | None = None,
) -> Consensus:
    if plan.sums:
        return RunningSums(present, _rounded(plan), links)
    return _averaging(plan, weights, bounds, workspace, links)


def _averaging(
    plan: Plan, weights: Floats, bounds: Floats, workspace: Workspace | None, links: Links | None
) -> Average:
    stage, payloads = plan.scenario.consensus, plan.payloads
    rounded = _rounded(plan)
    if stage.lag:
        return StaleAverage(weights, plan.motion, stage.lag, rounded=rounded, workspace=workspace)
    if stage.trim:
        if not isinstance(payloads, InformationPayloads):
            return TrimmedComponents(weights, stage.trim, rounded=rounded, workspace=workspace)
        return TrimmedMessages(weights, stage.trim, payloads.distance, rounded=rounded, workspace=workspace)
    if stage.acceleration == "chebyshev":
        return Chebyshev(weights, bounds[:, :1], bounds[:, 1:], rounded=rounded, workspace=workspace, links=links)
    if stage.trigger:
        return Triggered(
            *(weights, stage.trigger, plan.sharing.blocks),
            mistakes=plan.scenario.filter.defaults < 14,
            rounded=rounded,
            workspace=workspace,
        )
    return Average(weights, rounded=rounded, workspace=workspace, links=links)


def _guarded(stage: Consensus, plan: Plan, present: Bools, names: Ids) -> Consensus:
    """The averaging, without the neighbours that agents isolate; names: (n, m), the neighbours'."""
    if not plan.isolates or not isinstance(plan.payloads, InformationPayloads):
        return stage
    most, only = _knowable(plan), plan.scenario.filter.defaults > 11
    return Isolating(stage, plan.motion, plan.payloads.claims, present, names, most=most, only=only)


def _knowable(plan: Plan) -> Floats | None:
    """The most certain that an honest message can be, (s, s); None where that cannot be said."""
    scenario, motion = plan.scenario, plan.motion
    untold = plan.settings.learns_noise or plan.sums or scenario.filter.defaults < 3
    if untold or not isinstance(motion, LinearMotion):
        return None
    precision = scenario.count / plan.range_std**2
    most = most_information(motion, plan.initial_belief.known_covariance[0], precision, plan.space.axes)
    # Filters that begin with a first fix share the network's information in equal parts, others all of it.
    return most / plan.settings.network_size if plan.abilities.biases else most


def agent_tracker(plan: Plan, agent: int) -> tuple[Tracker, list[int]]:
    """One agent's tracker, a batch of one, and its neighbours' ids in ascending order."""
    row, belief = plan.neighbours.row(agent), plan.initial_belief
    weights = plan.weights[[agent]][:, plan.neighbours.present[agent]]
    tracker = Tracker(
        plan.filter,
        _guarded(_stage(plan, row.present, weights, plan.bounds[[agent]]), plan, row.present, row.index),
        plan.space,
        Belief(belief.state[[agent]], belief.known_covariance[[agent]]),
        plan.overcounted[[agent]],
    )
    return tracker, row.index[0].tolist()


def batch_tracker(plans: Sequence[Plan]) -> tuple[Tracker, graph.Neighbours]:
    """All agents of runs that differ only in their seed, as one batch of a disconnected graph."""
    batch = _Batch.of(plans)
    return batch.tracker(slice(None), batch.neighbours), batch.neighbours


def batch_parts(plans: Sequence[Plan], size: int, hears: Bools) -> tuple[Parts, graph.Neighbours]:
    """The same, as parts of so many agents each. hears: (n,), which agents ever measure a range.

    Those of a part have as many neighbours each, as far as possible, as a part's arrays are as wide as the most of
    them need; and they all hear or all do not, so that what only ranges ask for is left out.
    """
    batch = _Batch.of(plans)
    neighbours = batch.neighbours
    if len(hears) <= size:
        every = np.arange(len(hears), dtype=np.intp)
        return Parts([batch.part(slice(None), every, neighbours)]), neighbours
    degree = neighbours.degree
    # Rows with the same first neighbour have others in common: what one reads is in the cache for the next.
    order = np.lexsort((neighbours.index[:, 0] if neighbours.index.size else degree, degree, hears))
    parts, workspace = list[Part](), Workspace()
    for start in range(0, len(order), size):
        rows = order[start : start + size]
        width = int(degree[rows].max())
        own = graph.Neighbours(neighbours.index[rows, :width], neighbours.present[rows, :width])
        parts.append(batch.part(rows, rows, own, workspace))
    return Parts(parts), neighbours


@dataclass(frozen=True)
class _Batch:
    """All agents of runs, what they begin with and how they average: see `Plan`."""

    plan: Plan
    neighbours: graph.Neighbours
    weights: Floats
    bounds: Floats
    states: Floats
    covariances: Floats
    overcounted: Floats

    @classmethod
    def of(cls, plans: Sequence[Plan]) -> Self:
        neighbours = graph.stack([one.neighbours for one in plans])
        width = neighbours.index.shape[1]
        beliefs = [one.initial_belief for one in plans]
        return cls(
            plans[0],
            neighbours,
            np.concatenate([np.pad(one.weights, ((0, 0), (0, width - one.weights.shape[1]))) for one in plans]),
            np.concatenate([one.bounds for one in plans]),
            np.concatenate([one.state for one in beliefs]),
            np.concatenate([one.known_covariance for one in beliefs]),
            np.concatenate([one.overcounted for one in plans]),
        )

    def part(
        self,
        rows: slice | NDArray[np.intp],
        every: NDArray[np.intp],
        own: graph.Neighbours,
        workspace: Workspace | None = None,
    ) -> Part:
        """Some rows, which are `every`, and whose neighbours are `own`; workspace: shared with other rows."""
        links = Links(own) if _linked(self.plan) else None
        return Part(self.tracker(rows, own, workspace, links), every, own, linked=links is not None)

    def tracker(
        self,
        rows: slice | NDArray[np.intp],
        own: graph.Neighbours,
        workspace: Workspace | None = None,
        links: Links | None = None,
    ) -> Tracker:
        """The tracker of some rows, whose neighbours are `own`; workspace: shared with other rows."""
        plan, width = self.plan, own.index.shape[1]
        stage = _stage(
            plan, own.present, self.weights[rows, :width], self.bounds[rows], workspace=workspace, links=links
        )
        names = own.index % plan.scenario.count
        begin = Belief(self.states[rows], self.covariances[rows])
        guarded = _guarded(stage, plan, own.present, names)
        return Tracker(plan.filter, guarded, plan.space, begin, self.overcounted[rows])


def smoother_of(plan: Plan) -> FixedLag | None:
    """The smoother of one agent's estimates, or of a batch's; None where agents do not smooth."""
    return FixedLag(backwards_of(plan), plan.space, plan.smoothing_lag) if plan.smoothing_lag else None


def backwards_of(plan: Plan) -> Backwards:
    """By what a smoother goes back from step to step."""
    return SeveralMotions(plan.settings.switching) if plan.models or plan.noises else OneMotion(plan.motion)


def fates_of(plan: Plan, seed: Seeds, source: Ids, destination: Ids, *, realtime: bool = False) -> Fates:
    """The fates of the messages on directed links (e,) of runs that differ only in their seed (e,)."""
    return Fates(
        plan.scenario.fault,
        seed=seed,
        source=source,
        destination=destination,
        dt=plan.scenario.dt,
        rounds=plan.rounds,
        ranges=plan.sharing.uses_neighbour_ranges,
        realtime=realtime,
        lag=plan.scenario.consensus.lag,
        apart=_apart(plan.scenario, seed, source, destination),
    )


def _apart(scenario: Scenario, seed: Seeds, source: Ids, destination: Ids) -> Bools | None:
    """In which steps the ends of links (e,) are out of range of each other, (e, K); None where that is no matter."""
    if not network.by_radio(scenario):
        return None
    apart = np.empty((len(source), scenario.length), dtype=bool)
    for one in np.unique(seed):
        mine = seed == one
        near = network.in_range(scenario.changed(seed=int(one)))
        apart[mine] = ~near[source[mine], destination[mine]]
    return apart


def fates_into(plan: Plan, agent: int, sources: Sequence[int]) -> Fates:
    """The fates of the messages from neighbours into one agent, in the order of `sources`."""
    width = len(sources)
    return fates_of(
        plan,
        np.full(width, plan.scenario.seed, dtype=np.uint64),
        np.array(sources, dtype=np.int64),
        np.full(width, agent, dtype=np.int64),
        realtime=plan.realtime,
    )


def outgoing_of(plans: Sequence[Plan], agents: Sequence[int]) -> Outgoing:
    """What agents of runs that differ only in their seed really send: the same agents of each, run after run."""
    first = plans[0]
    return Outgoing(
        first.scenario.fault,
        seed=np.repeat(np.array([one.scenario.seed for one in plans], dtype=np.uint64), len(agents)),
        agent=np.tile(np.array(agents, dtype=np.int64), len(plans)),
        dt=first.scenario.dt,
        displaced=first.payloads.displaced,
        rounded=_rounded(first),
    )
