"""How much memory a scenario needs, and whether this host has that much."""

from __future__ import annotations

from zenoh_cbef.errors import UserError
from zenoh_cbef.machine import available_bytes
from zenoh_cbef.quantities import MOST_AGENTS
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.network import by_radio
from zenoh_cbef.scenario.plan import Plan

_WORLD = 130
"""Bytes that an emulated world takes for an agent in a step, while it is made."""
_SIMULATED = 540
_ANALYSED = 900
"""Bytes of a trace for an agent in a step, and what the analysis of one run takes besides; measured, not derived."""
_REMEMBERED = 7500
"""Bytes that an agent's belief, neighbours, weights and last message take; measured."""
_PAIR, _SPECTRUM = 60, 32
"""Bytes for two agents: of a graph that is chosen among all pairs, and of the eigenvalues of its weights."""
_IN_RANGE = 3
"""Arrays of one byte for two agents in a step, which the graph `radio` takes."""


def refuse_too_many_processes(scenario: Scenario) -> None:
    """Raise UserError where a scenario has more agents than a run of processes may have."""
    if scenario.count > MOST_AGENTS:
        raise UserError(
            f"{scenario.count} agents are too many for processes, which may be {MOST_AGENTS}: lower agents.count, or "
            "simulate them with 'sim'"
        )


def world_bytes(scenario: Scenario) -> int:
    """What the emulated world takes, which the target keeps, as well as any simulation."""
    apart = _IN_RANGE * scenario.count**2 if by_radio(scenario) else 0
    return scenario.length * (_WORLD * scenario.count + apart) + _graph_bytes(scenario)


def _graph_bytes(scenario: Scenario) -> int:
    """What making the graph takes, and the lists of neighbours, which are as long as the longest of them."""
    network, count = scenario.network, scenario.count
    if network.edges is not None:
        return 0
    pairs = count * (count - 1) // 2 if network.graph in {"erdos-renyi", "complete", "star", "radio"} else 0
    spectrum = scenario.consensus.acceleration == "chebyshev" and scenario.consensus.bounds is None
    return _PAIR * pairs + (_SPECTRUM * count**2 if spectrum else 0)


def simulation_bytes(plan: Plan, runs: int = 1) -> int:
    """What runs of a scenario take as arrays that are analysed."""
    scenario = plan.scenario
    cells = scenario.count * scenario.length
    # A large batch is computed in parts, and only its agents' memories are kept: what a filter remembers.
    state = _REMEMBERED * scenario.count * (1 if scenario.count > MOST_AGENTS else 0)
    return world_bytes(scenario) + runs * _SIMULATED * cells + _ANALYSED * cells + state


def refuse_a_trace_beyond_memory(plan: Plan, runs: int = 1) -> None:
    """Raise UserError where runs of a scenario cannot be simulated, or analysed, in this host's memory."""
    refuse_beyond_memory(simulation_bytes(plan, runs), plan.scenario, runs)


def refuse_beyond_memory(needed: int, scenario: Scenario, runs: int = 1) -> None:
    """Raise UserError where so many bytes are more than this host has left."""
    left = available_bytes()
    if left is None or needed <= left:
        return
    many = f"{runs} runs of " if runs > 1 else ""
    raise UserError(
        f"{many}{scenario.count} agents in {scenario.length} steps take about {_told(needed)} of memory, and "
        f"{_told(left)} are left; lower steps or agents.count{' or --seeds' if many else ''}{_of_pairs(scenario)}"
    )


def _of_pairs(scenario: Scenario) -> str:
    """What else helps where memory goes with the square of the agents."""
    return "; the graphs 'geometric', 'grid', 'ring' and 'path' take less" if _graph_bytes(scenario) > 10**9 else ""


def _told(size: int) -> str:
    for unit, power in (("TB", 1e12), ("GB", 1e9)):
        if size >= power:
            return f"{size / power:.3g} {unit}"
    return f"{size / 1e6:.0f} MB"
