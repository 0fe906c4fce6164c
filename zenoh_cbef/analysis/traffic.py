"""How many bytes a scenario's agents will publish, by encoding what they would send."""

from __future__ import annotations

from typing import Any

import numpy as np

from zenoh_cbef.faults.injected import FATES, Injected
from zenoh_cbef.protocol.messages import BIAS, DISTRUST, encode, pack_floats
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.scenario import Scenario, network
from zenoh_cbef.scenario.build import bias_of, distrusts_own, fates_into, filter_of, message_size, rounds_of
from zenoh_cbef.tracking import graph
from zenoh_cbef.tracking.filters import WITHOUT_COVARIANCE

_SENT = 1_700_000_000_000_000_000
_AGENTS, _STEPS = 12, 4
"""How many agents and steps of a run are looked at."""


def round_bytes(scenario: Scenario) -> int:
    """Bytes of one consensus message."""
    width = message_size(scenario)
    return len(RoundCodec(scenario.name, "agent/0", width).encode(0, _SENT, 1, 1, np.zeros(width)))


def other_bytes(scenario: Scenario) -> float:
    """Bytes that an agent publishes in a step besides its consensus messages: its range and its estimate.

    The mean over some agents and steps, as what faults do is told in the steps in which they do something.
    """
    lists = graph.neighbours(scenario.count, network.edges(scenario))
    agents = np.unique(np.linspace(0, scenario.count - 1, _AGENTS).round().astype(int))
    steps = np.unique(np.linspace(1, scenario.length, _STEPS + 2).round().astype(int))
    sizes = [
        _range_bytes(scenario, step) + _estimate_bytes(scenario, agent, lists.row(agent).index[0].tolist(), step)
        for agent in agents.tolist()
        for step in steps[1:-1].tolist() or [1]
    ]
    return float(np.mean(sizes))


def _range_bytes(scenario: Scenario, step: int) -> int:
    body = {"k": step, "position": [0.5] * 3, "range": 0.5}
    return len(encode(scenario.name, "agent/0", step, _SENT, body))


def _estimate_bytes(scenario: Scenario, agent: int, neighbours: list[int], step: int) -> int:
    estimate = {"k": step, "state": [0.5] * 6, "innovation": 0.5, "weight": 0.5, "nis": 0.5, "nis_degrees": 1}
    estimate |= {"neighbours": neighbours, "latency": [0.5] * len(neighbours), "covariance": None}
    estimate |= _counts(scenario, agent, neighbours, step)
    if distrusts_own(scenario):
        estimate[DISTRUST] = 0.0
    if bias_of(scenario) != "none":
        estimate |= dict.fromkeys(BIAS, 0.5)
    if scenario.filter.kind not in WITHOUT_COVARIANCE:
        estimate["covariance"] = pack_floats(np.zeros((6, 6)))
    return len(encode(scenario.name, f"agent/{agent}", step, _SENT, estimate))


def _counts(scenario: Scenario, agent: int, neighbours: list[int], step: int) -> dict[str, Any]:
    """What an agent tells of its neighbours' messages in a step, as if all steps before had been like this one."""
    rounds = range(not filter_of(scenario).uses_neighbour_ranges, rounds_of(scenario) + 1)
    counts: dict[str, Any] = {"received": [step * len(rounds)] * len(neighbours)}
    counts |= {name: [0] * len(neighbours) for name in ("lost", "late")}
    fates = fates_into(scenario, agent, neighbours)
    if fates.quiet:
        return counts
    injected = Injected(len(neighbours))
    for round_ in rounds:
        injected.note(fates.of(step, round_))
    told = {name: [step * one for one in ones] if name != FATES else ones for name, ones in injected.take().items()}
    gone = [told[name] for name in ("injected_lost", "corrupted", "injected_late")]
    counts["lost"] = [lost + corrupted for lost, corrupted, _ in zip(*gone, strict=True)]
    counts["late"] = told["injected_late"]
    counts["received"] = [step * len(rounds) - sum(each) for each in zip(*gone, strict=True)]
    return counts | told
