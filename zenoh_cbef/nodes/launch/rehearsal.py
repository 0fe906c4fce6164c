"""What every agent does first, done once by the process that forks them all: much is made when it is first used."""

from __future__ import annotations

from zenoh_cbef.nodes.common.briefing import card
from zenoh_cbef.plain import read_toml
from zenoh_cbef.scenario.build import agent_tracker
from zenoh_cbef.scenario.load import load, parse, to_toml
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.plugged import stamped

_SCENARIO, _FEW = "tracking", ("agents.count=3", "steps=3", "network.probability=0.9")


def rehearse() -> None:
    """Read a scenario as it comes from a target, plan it, make an agent's tracker, and look up its card."""
    tables = read_toml(to_toml(load(_SCENARIO, _FEW).scenario))
    agent_tracker(Plan(stamped(parse(tables, _SCENARIO))), 0)
    card()
