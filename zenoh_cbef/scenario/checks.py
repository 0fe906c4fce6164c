"""Refuses, before any process starts, a scenario that cannot work, and warns of one that will work badly."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from zenoh_cbef.datasets import read_dataset
from zenoh_cbef.errors import UserError
from zenoh_cbef.faults import MessageFault
from zenoh_cbef.quantities import MOST_AGENTS
from zenoh_cbef.scenario import fault_checks, paths, proportions, sight, size
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking import graph
from zenoh_cbef.tracking.linalg import neighbour_sum, outer
from zenoh_cbef.words import counted, first_of

_PROPORTION = 1e7
_CHEBYSHEV_LEFT = 0.25
"""The share of the disagreement, by the bound of its polynomial, that Chebyshev acceleration may leave: on grids and
paths of 6 to 300 agents it was lost from 0.39 on, worse than plain averaging mostly from 0.23 on, and better below."""
_NOTHING_LEFT = 50.0
_APART = 0.01
"""Which share of the agents may be apart from the others: of many that are placed at random some always are."""
_NAMED = 8


def check(plan: Plan) -> list[str]:
    """Warnings about a scenario, one sentence each. Raises UserError where it cannot work."""
    scenario = plan.scenario
    size.refuse_beyond_memory(size.world_bytes(scenario), scenario)
    warnings = _check_edges(scenario, plan.edges)
    _check_epsilon(scenario, plan.neighbours)
    fault_checks.refuse(plan)
    _check_signal(scenario)
    _check_precision(plan)
    _check_isolating(plan)
    _check_membership(scenario)
    _check_proportion(plan)
    warnings += _literal_gain(plan) if scenario.filter.kind == "cbef" else []
    warnings += _trimming(scenario, plan.neighbours) + _chebyshev(plan)
    warnings += fault_checks.warnings(plan) + _recorded_truth(scenario)
    return warnings + sight.warnings(plan) + proportions.warnings(plan)


def _check_membership(scenario: Scenario) -> None:
    if scenario.filter.membership is True and scenario.consensus.trigger:
        raise UserError(
            "filter.membership = true needs agents that say something in every round; set consensus.trigger = 0, or "
            "leave filter.membership out"
        )


def _check_isolating(plan: Plan) -> None:
    if plan.isolates and plan.bias == "estimate":
        raise UserError(
            "agents leave out liars, of which the scenario tells, and for that compare what messages say of position "
            "and velocity alone; set filter.bias = 'none' or 'auto', or consensus.isolate = false"
        )


def _recorded_truth(scenario: Scenario) -> list[str]:
    """Recordings of which the truth is known in a part only; the folder may be on another host."""
    folder = Path(scenario.target.path or "")
    if scenario.target.motion != "dataset" or not folder.is_dir():
        return []
    dataset = read_dataset(folder)
    if not dataset.has_truth:
        return []  # A user who has none needs no warning of it: errors are then left out everywhere.
    times = dataset.origin(scenario.dt) + paths.step_times(scenario, scenario.length)
    known = int(np.isfinite(dataset.truth_at(times)).all(axis=1).sum())
    if known == len(times):
        return []
    seconds = f"{known * scenario.dt:.3g} of {len(times) * scenario.dt:.3g} s"
    return [f"{folder / 'truth.csv'} covers {known} of {len(times)} steps ({seconds}): only these are scored"]


def _check_edges(scenario: Scenario, edges: graph.Edges) -> list[str]:
    count = scenario.count
    if len(edges) and (edges.max() >= count or (edges[:, 0] == edges[:, 1]).any()):
        bad = next(edge for edge in edges.tolist() if edge[1] >= count or edge[0] == edge[1])
        raise UserError(
            f"network.edges: {bad} does not join two of the {count} agents 0 to {count - 1}; correct that edge"
        )
    parts = graph.components(count, edges)
    apart = count - max(map(len, parts))
    if apart > (_APART * count if count > MOST_AGENTS else 0):
        raise UserError(
            f"the network falls apart: agents {_named(parts[1])} cannot reach agents {_named(parts[0])}; "
            "add edges, or choose another network.graph, probability or radius"
        )
    many = f"{counted(apart, 'agent')} of {count}"
    warning = f"{many} cannot reach the others, and track without them; raise network.radius, or add edges"
    return [warning] if apart else []


def _named(agents: list[int]) -> str:
    return first_of([*map(str, agents)], _NAMED)


def _check_epsilon(scenario: Scenario, neighbours: graph.Neighbours) -> None:
    given = scenario.consensus.epsilon
    if scenario.consensus.weights != "uniform" or given is None:
        return
    limit = 1.0 / max(1, int(neighbours.degree.max(initial=0)))
    if given >= limit:
        raise UserError(
            f"consensus.epsilon = {given} is at or above the stable limit 1/(largest degree) = {limit:.6g} "
            "of this graph; lower it, or leave it out"
        )


def _check_precision(plan: Plan) -> None:
    stage, chosen = plan.scenario.consensus, plan.scenario.filter
    whole = stage.precision.startswith("int")
    if stage.trigger and plan.isolates:
        raise UserError(
            f"consensus.trigger = {stage.trigger:g}: agents that leave out liars judge what each says in every round; "
            "set consensus.trigger = 0, or consensus.isolate = false"
        )
    if not (whole or stage.trigger) or plan.sharing.blocks or not plan.rounds:
        return
    what = "several motions" if plan.models else repr(chosen.kind)
    key = f"consensus.precision = {stage.precision!r}" if whole else f"consensus.trigger = {stage.trigger:g}"
    remedy = "consensus.precision = 'float32'" if whole else "consensus.trigger = 0"
    raise UserError(
        f"{key} is for payloads of information on one motion, as of 'sicf', 'icf' and 'ci', and this filter is of "
        f"{what}; set {remedy}"
    )


def _check_signal(scenario: Scenario) -> None:
    # Times are float64 seconds of run time; the range's resolution is their spacing times the signal speed.
    last = scenario.length * scenario.dt
    resolution = float(np.spacing(last)) * scenario.sensor.signal_speed
    if resolution > 0.1 * scenario.sensor.range_std:
        raise UserError(
            f"after {last:.6g} s the clock resolves ranges to {resolution:.3g} m only, too coarse for "
            f"sensor.range_std = {scenario.sensor.range_std}; shorten the run or lower sensor.signal_speed"
        )


def _check_proportion(plan: Plan) -> None:
    # Variances are inverted: beyond half of float64's digits between standard deviations nothing is left of them.
    begin = plan.initial_belief
    covariance = plan.motion.predict_covariance(begin.known_covariance[:1], begin.state[:1])[0]
    chosen, range_std = plan.scenario.filter, plan.range_std
    unknown = {
        "the state's after one step (it follows from filter.initial_position_std, filter.initial_velocity_std, dt and "
        "acceleration_std)": float(np.sqrt(np.diagonal(covariance).max())),
        "filter.bias_common_std": chosen.bias_common_std or 0.0,
        "filter.bias_own_std": chosen.bias_own_std or 0.0,
    }
    for name, std in unknown.items():
        if std > _PROPORTION * range_std:
            raise UserError(
                f"standard deviations are out of proportion: {name} is {std:.3g}, more than {_PROPORTION:g} times "
                f"the ranges' of {range_std:g} m; bring them closer together"
            )


def _trimming(scenario: Scenario, neighbours: graph.Neighbours) -> list[str]:
    # A (2F + 1)-robust graph is what W-MSR needs (LeBlanc et al. 2013); that many neighbours are necessary for it.
    trim, least = scenario.consensus.trim, int(np.argmin(neighbours.degree))
    needed = 2 * trim + 1
    if trim == 0 or neighbours.degree[least] >= needed:
        return []
    warning = (
        f"consensus.trim = {trim} needs a graph in which every agent has {needed} neighbours or more, but "
        f"agent {least} has {neighbours.degree[least]}; add edges, or lower consensus.trim"
    )
    return [warning]


def _chebyshev(plan: Plan) -> list[str]:
    stage = plan.scenario.consensus
    if stage.acceleration != "chebyshev":
        return []
    return _chebyshev_with_faults(plan.scenario) + _chebyshev_too_short(plan)


def _chebyshev_too_short(plan: Plan) -> list[str]:
    """A polynomial of too low a degree weighs messages negatively, and estimates are wrong, not only apart."""
    low, high = plan.bounds[0]
    ratio = 0.5 * (high - low) / (1.0 - 0.5 * (high + low))
    if not 0.0 < ratio < 1.0:
        return []
    rounds, growth = plan.rounds, float(np.arccosh(1.0 / ratio))
    left = float(1.0 / np.cosh(min(rounds * growth, _NOTHING_LEFT)))
    if left <= _CHEBYSHEV_LEFT:
        return []
    needed = int(np.ceil(np.arccosh(1.0 / _CHEBYSHEV_LEFT) / growth))
    warning = (
        f"in {rounds} rounds Chebyshev acceleration leaves up to {100.0 * left:.0f} % of the disagreement here: "
        f"with more than {100.0 * _CHEBYSHEV_LEFT:.0f} % estimates are often worse than with plain averaging, or lost; "
        f"set consensus.rounds = {needed}, or consensus.acceleration = 'none'"
    )
    return [warning]


def _chebyshev_with_faults(scenario: Scenario) -> list[str]:
    links = [fault.kind for fault in scenario.fault if isinstance(fault, MessageFault)]
    if not links:
        return []
    warning = (
        f"Chebyshev acceleration presumes that no message is missing, and with {links[0]} it is worse than plain "
        "averaging; set consensus.acceleration = 'none', and consensus.scheme = 'auto' repairs what is lost"
    )
    return [warning]


def _literal_gain(plan: Plan) -> list[str]:
    scenario, neighbours, axes = plan.scenario, plan.neighbours, plan.space.axes
    positions = paths.placement(scenario)
    rows = positions[neighbours.index] - positions[:, None, :]
    rows = np.where(neighbours.present[:, :, None], rows, 0.0)[:, :, :axes]
    gram = neighbour_sum(outer(rows.reshape(-1, axes), rows.reshape(-1, axes)).reshape(*rows.shape, axes))
    largest = np.linalg.eigvalsh(gram)[:, -1]
    worst = int(np.argmax(largest))
    if largest[worst] < 2.0:
        return []
    warning = (
        f"cbef may not converge: the largest eigenvalue of H^T H is {largest[worst]:.3g} at agent {worst} "
        f"({int((largest >= 2.0).sum())} of {scenario.count} agents are at 2 or more; all below is sufficient, "
        "not necessary); its gain is H^T itself, so place agents about one unit apart, or use filter.kind = 'sicf'"
    )
    return [warning]
