"""The tracker that a scenario describes, for one agent or for all agents of many runs at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.faults import Absences, Fates, MessageFault, Outgoing, SensorFault
from zenoh_cbef.scenario import network
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.start import distrusts, first_fix_steps, initial_belief, space_of
from zenoh_cbef.tracking import graph, weights
from zenoh_cbef.tracking.consensus import Average, Chebyshev, Consensus, RunningSums
from zenoh_cbef.tracking.filters import Belief, Filter, FilterSettings, abilities_of, make_filter
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.payloads import InformationPayloads, StatePayloads
from zenoh_cbef.tracking.stale import StaleAverage
from zenoh_cbef.tracking.tracker import Tracker
from zenoh_cbef.tracking.trimmed import TrimmedComponents, TrimmedMessages

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ids = NDArray[np.int64]
Seeds = NDArray[np.uint64]

_RECORDED_ACCELERATION = 1.0
"""What is assumed of a real target of which nothing is said, m/s^2: somebody walking, a trolley, a slow vehicle."""


def motion_of(scenario: Scenario) -> NearlyConstantVelocity:
    """The filter's model of the target's motion."""
    chosen, assumed = scenario.filter, scenario.filter.acceleration_std
    if assumed is None:
        recorded = scenario.target.motion == "dataset"
        assumed = _RECORDED_ACCELERATION if recorded else scenario.target.acceleration_std
    if chosen.acceleration_interval is not None:
        # The same power of the noise in a second, however long a step is.
        assumed *= float(np.sqrt(chosen.acceleration_interval / scenario.dt))
    return NearlyConstantVelocity(scenario.dt, assumed, space_of(scenario).axes)


def range_std_of(scenario: Scenario) -> float:
    """The range noise that the filter assumes, m; where it is learned, what it begins with."""
    assumed = scenario.filter.range_std
    return scenario.sensor.range_std if assumed is None or assumed == "auto" else assumed


def bias_of(scenario: Scenario) -> str:
    """What the filter does about biases: none, estimate, or auto where it can weigh them.

    As with the noise, a filter that is told nothing knows of emulated receivers what the scenario says: those that
    have no bias need no states for it, and cost half the arithmetic and half the bytes.
    """
    chosen = scenario.filter
    if not abilities_of(chosen.kind).biases:
        return "none"
    if chosen.bias == "auto" and (chosen.recovery or distrusts(scenario) or not _may_be_biased(scenario)):
        return "none"
    return chosen.bias


def _may_be_biased(scenario: Scenario) -> bool:
    sensor, disturbed = scenario.sensor, any(isinstance(fault, SensorFault) for fault in scenario.fault)
    biased = bool(np.any(np.array(sensor.bias))) or sensor.bias_std > 0.0
    return biased or disturbed or scenario.target.motion == "dataset"


def distrusts_own(scenario: Scenario) -> bool:
    """Whether agents distrust their own receivers while these are implausible; auto: where receivers have faults."""
    chosen = scenario.filter
    if chosen.distrust != "auto":
        return chosen.distrust
    averages = abilities_of(chosen.kind).information
    comparable = averages and chosen.measurement == "range" and not distrusts(scenario)
    return comparable and any(isinstance(fault, SensorFault) for fault in scenario.fault)


def settings_of(scenario: Scenario) -> FilterSettings:
    """What the scenario's filter is told."""
    chosen, range_std = scenario.filter, range_std_of(scenario)
    common, own = chosen.bias_common_std, chosen.bias_own_std
    return FilterSettings(
        motion_of(scenario),
        space_of(scenario),
        range_std,
        chosen.xi,
        # Without rounds everybody is a network of one.
        scenario.count if scenario.consensus.rounds else 1,
        chosen.omega,
        chosen.measurement == "difference",
        power_of(scenario),
        chosen.recovery,
        distrusts_own(scenario),
        bias_of(scenario),
        1.5 * range_std if common is None else common,
        0.15 * range_std if own is None else own,
        chosen.range_std == "auto",
        first_fix_steps(scenario),
    )


def power_of(scenario: Scenario) -> int:
    """The power of the saturation: 1 bounds the pull of an outlier, 2 lets it fall (redescending).

    Real ranges have outliers. But where biases are left alone or the noise is still learned, good ones may look alike.
    """
    chosen = scenario.filter.saturation
    if chosen == "auto":
        known = bias_of(scenario) != "none" and scenario.filter.range_std != "auto"
        recorded = scenario.target.motion == "dataset" and known
        chosen = "redescending" if recorded or scenario.sensor.outlier_probability > 0.0 else "bounded"
    return 2 if chosen == "redescending" else 1


def filter_of(scenario: Scenario) -> Filter:
    """The scenario's filter."""
    return make_filter(scenario.filter.kind, settings_of(scenario))


def payloads_of(scenario: Scenario) -> InformationPayloads | StatePayloads:
    """How to read the payloads of the scenario's filter."""
    axes, size, kind = space_of(scenario).axes, motion_of(scenario).size, scenario.filter.kind
    if not abilities_of(kind).information:
        return StatePayloads(axes)
    omega = float(scenario.count) if scenario.filter.omega is None else scenario.filter.omega
    size += bias_of(scenario) == "estimate"  # The common part of the bias is one more state.
    return InformationPayloads(axes, size, (1.0, omega) if kind == "hcmci" else (1.0,))


def slot_of(scenario: Scenario) -> float:
    """How long a round lasts in realtime, s: the beacon, and then each round, has to come within one."""
    given = scenario.timing.round_deadline_ms
    return scenario.dt / (rounds_of(scenario) + 1) if given is None else 1e-3 * given


def rounds_of(scenario: Scenario) -> int:
    """Consensus rounds per step; none for a filter that keeps to itself."""
    return scenario.consensus.rounds if filter_of(scenario).cooperates else 0


def scheme_of(scenario: Scenario) -> tuple[str, str]:
    """The consensus scheme, average or running-sums, and one sentence on why it was chosen."""
    stage, kind = scenario.consensus, scenario.filter.kind
    if stage.scheme != "auto":
        return stage.scheme, f"consensus.scheme = {stage.scheme!r} was given."
    quiet = not any(isinstance(fault, MessageFault) for fault in scenario.fault)
    stateful = not abilities_of(kind).information
    reasons = {
        "Messages of earlier steps are predicted forward, which running sums cannot be.": stage.lag > 0,
        "Neighbours' values are trimmed, which running sums cannot be.": stage.trim > 0,
        "No link has a fault, so averaging loses nothing.": quiet,
        f"{kind} does not average information, and its exchange is defined by consensus weights.": stateful,
        f"Running sums cannot be accelerated, and {stage.acceleration} was asked for.": stage.acceleration != "none",
    }
    for reason, holds in reasons.items():
        if holds:
            return "average", reason
    return "running-sums", "Links have faults, and with running sums the next message repairs a lost one."


def message_size(scenario: Scenario) -> int:
    """How many numbers a consensus message holds: the payload's, and one more for running sums."""
    return filter_of(scenario).payload_size + (scheme_of(scenario)[0] == "running-sums")


def consensus_of(scenario: Scenario, neighbours: graph.Neighbours) -> tuple[Floats, Floats]:
    """Consensus weights (n, m), and the least and largest eigenvalue of W other than 1, (n, 2)."""
    chosen = network.consensus_weights(scenario, neighbours)
    bounds = (0.0, 0.0)
    if scenario.consensus.acceleration == "chebyshev":
        given = scenario.consensus.bounds
        bounds = weights.spectrum_bounds(weights.weight_matrix(neighbours, chosen)) if given is None else given
    return chosen, np.tile(bounds, (scenario.count, 1))


def _stage(scenario: Scenario, present: Bools, chosen: Floats, bounds: Floats) -> Consensus:
    if scheme_of(scenario)[0] == "running-sums":
        return RunningSums(present)
    if scenario.consensus.lag:
        return StaleAverage(chosen, motion_of(scenario), scenario.consensus.lag)
    trim, payloads = scenario.consensus.trim, payloads_of(scenario)
    if trim and isinstance(payloads, InformationPayloads):
        return TrimmedMessages(chosen, trim, payloads.distance)
    if trim:
        return TrimmedComponents(chosen, trim)
    if scenario.consensus.acceleration == "chebyshev":
        return Chebyshev(chosen, bounds[:, :1], bounds[:, 1:])
    return Average(chosen)


def agent_tracker(scenario: Scenario, agent: int) -> tuple[Tracker, list[int]]:
    """One agent's tracker, a batch of one, and its neighbours' ids in ascending order."""
    neighbours = graph.neighbours(scenario.count, network.edges(scenario))
    chosen, bounds = consensus_of(scenario, neighbours)
    row = neighbours.row(agent)
    belief = initial_belief(scenario)
    tracker = Tracker(
        filter_of(scenario),
        _stage(scenario, row.present, chosen[[agent]][:, neighbours.present[agent]], bounds[[agent]]),
        space_of(scenario),
        Belief(belief.state[[agent]], belief.known_covariance[[agent]]),
    )
    return tracker, row.index[0].tolist()


def batch_tracker(scenarios: Sequence[Scenario]) -> tuple[Tracker, graph.Neighbours]:
    """All agents of runs that differ only in their seed, as one batch of a disconnected graph."""
    first = scenarios[0]
    lists = [graph.neighbours(one.count, network.edges(one)) for one in scenarios]
    stages = [consensus_of(one, each) for one, each in zip(scenarios, lists, strict=True)]
    neighbours = graph.stack(lists)
    width = neighbours.index.shape[1]
    chosen = np.concatenate([np.pad(each, ((0, 0), (0, width - each.shape[1]))) for each, _ in stages])
    beliefs = [initial_belief(one) for one in scenarios]
    tracker = Tracker(
        filter_of(first),
        _stage(first, neighbours.present, chosen, np.concatenate([bounds for _, bounds in stages])),
        space_of(first),
        Belief(
            np.concatenate([one.state for one in beliefs]),
            np.concatenate([one.known_covariance for one in beliefs]),
        ),
    )
    return tracker, neighbours


def absences_of(scenario: Scenario) -> Absences:
    """When the scenario's agents are not there."""
    return Absences(scenario.fault, agents=scenario.count, dt=scenario.dt, steps=scenario.length)


def fates_of(scenario: Scenario, seed: Seeds, source: Ids, destination: Ids, *, realtime: bool = False) -> Fates:
    """The fates of the messages on directed links (e,) of runs that differ only in their seed (e,)."""
    return Fates(
        scenario.fault,
        seed=seed,
        source=source,
        destination=destination,
        dt=scenario.dt,
        rounds=rounds_of(scenario),
        ranges=filter_of(scenario).uses_neighbour_ranges,
        realtime=realtime,
        lag=scenario.consensus.lag,
        apart=_apart(scenario, seed, source, destination),
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


def fates_into(scenario: Scenario, agent: int, sources: Sequence[int]) -> Fates:
    """The fates of the messages from neighbours into one agent, in the order of `sources`."""
    width = len(sources)
    return fates_of(
        scenario,
        np.full(width, scenario.seed, dtype=np.uint64),
        np.array(sources, dtype=np.int64),
        np.full(width, agent, dtype=np.int64),
        realtime=scenario.timing.mode == "realtime",
    )


def outgoing_of(scenarios: Sequence[Scenario], agents: Sequence[int]) -> Outgoing:
    """What agents of runs that differ only in their seed really send: the same agents of each, run after run."""
    first = scenarios[0]
    return Outgoing(
        first.fault,
        seed=np.repeat(np.array([one.seed for one in scenarios], dtype=np.uint64), len(agents)),
        agent=np.tile(np.array(agents, dtype=np.int64), len(scenarios)),
        dt=first.dt,
        displaced=payloads_of(first).displaced,
    )
