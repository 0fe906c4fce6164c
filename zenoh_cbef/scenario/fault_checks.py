"""Refuses faults that cannot be, and warns of those that do nothing, or leave nothing to be learned."""

from __future__ import annotations

from zenoh_cbef.errors import UserError
from zenoh_cbef.faults import Crash, Fault, SenderFault
from zenoh_cbef.scenario import trust
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking import filters, graph


def refuse(plan: Plan) -> None:
    """Raise UserError for faults that cannot be."""
    scenario = plan.scenario
    for number, fault in enumerate(scenario.fault):
        unknown = sorted(agent for agent in fault.named() if agent >= scenario.count)
        if unknown:
            raise UserError(
                f"fault {number} ({fault.kind}) names agent {unknown[0]}, but agents are 0 to {scenario.count - 1}"
            )
        if fault.until is not None and fault.until <= fault.since:
            raise UserError(f"fault {number} ({fault.kind}): until must be later than from")
    _check_absences(plan)


def _check_absences(plan: Plan) -> None:
    scenario, absences, settled = plan.scenario, plan.absences, plan.closed_steps
    if not absences.any:
        return
    if absences.empty is not None:
        raise UserError(
            f"at {absences.empty * scenario.dt:g} s none of the {scenario.count} agents is there to track; "
            "leave one of them out of the faults of kind crash and pause"
        )
    for step in range(1, min(settled, scenario.length) + 1):
        if absences.reborn(step).any():
            agent = int(absences.reborn(step).argmax())
            raise UserError(
                f"agent {agent} comes back after a crash at {step * scenario.dt:g} s, when the network still looks for "
                f"its first fix; let it come back after {settled * scenario.dt:g} s, or give filter.initial_position"
            )
    crashed = {agent for fault in scenario.fault if isinstance(fault, Crash) for agent in fault.agents}
    for number, fault in enumerate(scenario.fault):
        if isinstance(fault, SenderFault) and fault.memory and crashed & fault.named():
            raise UserError(
                f"fault {number} ({fault.kind}) replays what agent {min(crashed & fault.named())} sent, but that one "
                "crashes and remembers nothing; let another agent replay or crash"
            )


def warnings(plan: Plan) -> list[str]:
    """Warnings, a sentence each with its remedy."""
    scenario, edges = plan.scenario, plan.edges
    of_liars = _only_links(scenario, edges) + _all_lie(scenario) + _biases_beside_liars(plan) + _unsuspected(plan)
    return of_liars + _of_no_link(scenario, edges) + _in_no_step(scenario)


def _biases_beside_liars(plan: Plan) -> list[str]:
    scenario = plan.scenario
    chosen, able = scenario.filter, filters.abilities_of(scenario.filter.kind).biases
    told = plan.distrusts_others and trust.tells_biases(scenario) and able
    if not told or chosen.bias != "auto" or plan.bias != "none":
        return []
    warning = (
        "the scenario tells of biases of ranges, but filter.bias = 'auto' is 'none' here, as agents that doubt what "
        "others send estimate no biases: they will be too sure of themselves; calibrate the receivers "
        "(sensor.bias = 0, sensor.bias_std = 0), or do without faults of senders, consensus.trim and consensus.isolate"
    )
    return [warning]


def liars(scenario: Scenario) -> set[int]:
    """The agents that a scenario ever lets send wrong values."""
    return {agent for fault in scenario.fault if isinstance(fault, SenderFault) for agent in fault.agents}


def _unsuspected(plan: Plan) -> list[str]:
    """That agents go by what a liar sends which comes as a surprise."""
    if plan.isolates or plan.scenario.consensus.trim or not plan.rounds:
        return []
    return [
        f"fault {number} ({fault.kind}): agents of this run leave out no neighbour that sends wrong values, as its "
        "scenario told of none, so all are led astray; end the fault, or start with consensus.isolate = true"
        for number, fault in enumerate(plan.scenario.fault)
        if isinstance(fault, SenderFault) and fault.injected
    ]


def _all_lie(scenario: Scenario) -> list[str]:
    if len(liars(scenario)) < scenario.count:
        return []
    many = "the only agent sends" if scenario.count == 1 else f"all {scenario.count} agents send"
    return [f"{many} wrong values, so there is no honest one of which errors tell; leave agents out of fault.agents"]


def _in_no_step(scenario: Scenario) -> list[str]:
    end = scenario.length * scenario.dt
    return [
        f"fault {number} ({fault.kind}) is on in no step of the run, which ends at {end:g} s, so it does nothing; "
        "change its from and until"
        for number, fault in enumerate(scenario.fault)
        if not _is_ever_on(fault, scenario)
    ]


def _is_ever_on(fault: Fault, scenario: Scenario) -> bool:
    # The first step in question, or by rounding one of its neighbours.
    first = min(int(fault.since / scenario.dt), scenario.length)
    return any(fault.active(step * scenario.dt) for step in range(max(1, first), min(first + 2, scenario.length) + 1))


def _only_links(scenario: Scenario, edges: graph.Edges) -> list[str]:
    warnings = []
    for liar in sorted(liars(scenario)):
        left = edges[(edges != liar).all(axis=1)]
        others = [each for each in graph.components(scenario.count, left) if each != [liar]]
        if len(others) > 1:
            warnings.append(
                f"agent {liar}, which sends wrong values, is the only link between agents {others[0]} and {others[1]}: "
                "whatever these find out, they cannot help each other; add edges between them"
            )
    return warnings


def _of_no_link(scenario: Scenario, edges: graph.Edges) -> list[str]:
    joined = {frozenset(edge) for edge in edges.tolist()}
    warnings = []
    for number, fault in enumerate(scenario.fault):
        links = getattr(fault, "links", "all")
        named = links if isinstance(links, tuple) else ()
        apart = [list(link) for link in named if frozenset(link) not in joined]
        if apart:
            warnings.append(
                f"fault {number} ({fault.kind}) names the link {apart[0]}, but these agents are not neighbours in "
                "this graph, so it does nothing there; 'scenario check' lists the edges"
            )
    return warnings
