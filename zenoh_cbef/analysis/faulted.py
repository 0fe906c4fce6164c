"""Faults as the page shows them: a span of time, a place, and words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef.arrays import Bools
from zenoh_cbef.faults import Absence, Fault, LinkFault, SenderFault, SensorFault
from zenoh_cbef.faults.base import Between
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.fault_checks import liars


def honest_agents(scenario: Scenario) -> Bools:
    """Which agents a scenario never lets send wrong values, (n,); all, if none is left."""
    wrong = liars(scenario)
    honest = np.array([agent not in wrong for agent in range(scenario.count)])
    return honest if honest.any() else np.ones_like(honest)


def faults_of(scenario: Scenario) -> list[dict[str, object]]:
    """Each fault: kind, words, from and until (s; until null for good), the agents that it names, and what it touches.

    touches: agents that are away, "lies" or "receiver"; or links. The words have the agents' names.
    """
    return [_told(fault, scenario.agents.names) for fault in scenario.fault]


def _told(fault: Fault, names: Sequence[str]) -> dict[str, object]:
    touched: dict[type[Fault], str] = {Absence: "away", SenderFault: "lies", SensorFault: "receiver"}
    touches = next((word for kind, word in touched.items() if isinstance(fault, kind)), "links")
    words = f"{fault.kind.replace('-', ' ')}{_amount(fault)}{_where(fault, names)}"
    span = {"from": fault.since, "until": fault.until}
    return {"kind": fault.kind, "words": words, **span, "agents": sorted(fault.named()), "touches": touches}


def _amount(fault: Fault) -> str:
    for name, factor, unit in (("probability", 100.0, "%"), ("milliseconds", 1.0, "ms"), ("bias", 1.0, "m")):
        if isinstance(value := getattr(fault, name, None), int | float):
            return f" {factor * value:.3g} {unit}"
    return ""


def _where(fault: Fault, names: Sequence[str]) -> str:
    if not isinstance(fault, LinkFault):
        agents = sorted(fault.named())
        return f" of agent {_listed(agents, names)}" if agents else ""
    links = fault.links
    if isinstance(links, str):
        return "" if links == "all" else f" at agent {names[int(links.removeprefix('agent:'))]}"
    if isinstance(links, Between):
        return " between " + " and ".join(_listed(group, names) for group in links.between)
    pairs = sorted({(min(pair), max(pair)) for pair in links})
    return " of " + ", ".join(f"{names[first]}\u2013{names[second]}" for first, second in pairs)


def _listed(agents: Sequence[int], names: Sequence[str]) -> str:
    return ", ".join(names[agent] for agent in agents)
