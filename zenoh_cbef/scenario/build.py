"""Makes what a plan needs to run: trackers, fates of messages, faults of senders; for one agent or a batch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats, Ids
from zenoh_cbef.faults import Fates, Outgoing
from zenoh_cbef.scenario import network
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking import graph
from zenoh_cbef.tracking.backwards import Backwards, OneMotion, SeveralMotions
from zenoh_cbef.tracking.consensus import Average, Chebyshev, Consensus, Rounding, RunningSums
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.isolating import Isolating
from zenoh_cbef.tracking.knowable import most_information
from zenoh_cbef.tracking.motion import LinearMotion
from zenoh_cbef.tracking.payloads import InformationPayloads
from zenoh_cbef.tracking.smoothing import FixedLag
from zenoh_cbef.tracking.stale import StaleAverage
from zenoh_cbef.tracking.switching import Switching
from zenoh_cbef.tracking.tracker import Tracker
from zenoh_cbef.tracking.trimmed import TrimmedComponents, TrimmedMessages

Seeds = NDArray[np.uint64]


def _rounded(plan: Plan) -> Rounding | None:
    """What receivers take messages to be; None where these are in all their bits."""
    return None if plan.compact is None else plan.compact.rounded


def _stage(plan: Plan, present: Bools, weights: Floats, bounds: Floats) -> Consensus:
    stage, payloads = plan.scenario.consensus, plan.payloads
    rounded = _rounded(plan)
    if plan.sums:
        return RunningSums(present, rounded)
    if stage.lag:
        return StaleAverage(weights, plan.motion, stage.lag, rounded=rounded)
    if stage.trim and isinstance(payloads, InformationPayloads):
        return TrimmedMessages(weights, stage.trim, payloads.distance, rounded=rounded)
    if stage.trim:
        return TrimmedComponents(weights, stage.trim, rounded=rounded)
    if stage.acceleration == "chebyshev":
        return Chebyshev(weights, bounds[:, :1], bounds[:, 1:], rounded=rounded)
    return Average(weights, rounded=rounded)


def _guarded(stage: Consensus, plan: Plan, present: Bools, names: Ids) -> Consensus:
    """The averaging, without the neighbours that agents isolate; names: (n, m), the neighbours'."""
    if not plan.isolates or not isinstance(plan.payloads, InformationPayloads):
        return stage
    return Isolating(stage, plan.motion, plan.payloads.claims, present, names, most=_knowable(plan))


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
    )
    return tracker, row.index[0].tolist()


def batch_tracker(plans: Sequence[Plan]) -> tuple[Tracker, graph.Neighbours]:
    """All agents of runs that differ only in their seed, as one batch of a disconnected graph."""
    first, neighbours = plans[0], graph.stack([one.neighbours for one in plans])
    width = neighbours.index.shape[1]
    weights = [np.pad(one.weights, ((0, 0), (0, width - one.weights.shape[1]))) for one in plans]
    bounds = np.concatenate([one.bounds for one in plans])
    beliefs = [one.initial_belief for one in plans]
    tracker = Tracker(
        first.filter,
        _guarded(
            _stage(first, neighbours.present, np.concatenate(weights), bounds),
            first,
            neighbours.present,
            neighbours.index % first.scenario.count,
        ),
        first.space,
        Belief(
            np.concatenate([one.state for one in beliefs]),
            np.concatenate([one.known_covariance for one in beliefs]),
        ),
    )
    return tracker, neighbours


def smoother_of(plan: Plan) -> FixedLag | None:
    """The smoother of one agent's estimates, or of a batch's; None where agents do not smooth."""
    return FixedLag(backwards_of(plan), plan.space, plan.smoothing_lag) if plan.smoothing_lag else None


def backwards_of(plan: Plan) -> Backwards:
    """By what a smoother goes back from step to step."""
    if not plan.models:
        return OneMotion(plan.motion)
    return SeveralMotions(Switching(plan.models, plan.settings.leaving))


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
        near = network.in_range(scenario.model_copy(update={"seed": int(one)}))
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
