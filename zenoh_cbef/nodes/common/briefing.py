"""How a process gets the scenario of its run before it takes part, and how it introduces itself."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from platform import node as host_name

from zenoh_cbef import __version__
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.plain import read_toml
from zenoh_cbef.protocol.scenario_service import Clock, ScenarioText, fetch_scenario, measure_clock
from zenoh_cbef.protocol.tokens import in_words
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.plugged import stamped
from zenoh_cbef.scenario.size import refuse_too_many_processes

HERE = "here"
"""Kind of the event with which a process says where it is."""


@dataclass(frozen=True)
class Briefing:
    """text: the scenario as the target told it. clock: ours against the target's, None where it tells no time."""

    text: ScenarioText
    plan: Plan
    clock: Clock | None

    @property
    def scenario(self) -> Scenario:
        """What the run is."""
        return self.plan.scenario


def brief(node: Node) -> Briefing:
    """Ask the target for the scenario, for as long as the process's patience lasts.

    Raises UserError where no target answers, or one of another version, or one with other plug-ins.
    """
    run = node.identity.run
    left = max(0.0, node.born + node.identity.patience - time.monotonic())
    text = fetch_scenario(node.session, run, node.identity.connection, patience=left, stopped=node.waits)
    if text.program != __version__:
        raise UserError(
            f"run {run!r} is of zenoh-cbef {text.program}, this is {__version__}; "
            "install the same version on every host"
        )
    try:
        tables = read_toml(text.resolved)
    except ValueError as error:
        raise UserError(f"the scenario of run {run!r} is no scenario: {error}; is its target a zenoh-cbef?") from None
    scenario = stamped(parse(tables, f"the scenario of run {run!r}"))
    refuse_too_many_processes(scenario)
    if max(text.agents, default=0) >= scenario.count:
        raise UserError(f"run {run!r} tells of agents that its scenario does not have; is its target a zenoh-cbef?")
    return Briefing(text, Plan(scenario), measure_clock(node.session, run))


def introduce(identity: Identity, clock: Clock | None, say: Callable[..., None]) -> None:
    """Tell the target and the log where this process is. say: publishes an event of a kind, with a text and data."""
    told = card()
    about = {} if clock is None else {"clock": clock.ahead, "round_trip": clock.round_trip}
    name = in_words(identity.sender)
    say(HERE, f"{name} is process {told['pid']} on {told['host']}", **told, **about)


def card() -> dict[str, object]:
    """Where this process is, and what it is made of."""
    return {"host": host_name(), "pid": os.getpid(), "version": __version__, "zenoh": _zenoh_version()}


@cache
def _zenoh_version() -> str:
    # Looked up in files.
    return version("eclipse-zenoh")
