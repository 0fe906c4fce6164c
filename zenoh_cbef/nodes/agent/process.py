"""The agent process, from its start to its end."""

from __future__ import annotations

from collections.abc import Callable

from zenoh_cbef.errors import UserError
from zenoh_cbef.machine import require
from zenoh_cbef.nodes.agent.agent import Agent
from zenoh_cbef.nodes.agent.entrance import Entrance
from zenoh_cbef.nodes.common.briefing import brief
from zenoh_cbef.nodes.common.ending import Ending
from zenoh_cbef.nodes.common.links import Links
from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.nodes.common.succession import Succession


def run_agent(identity: Identity, report: Callable[[str], None] = lambda _: None) -> int:
    """Run one agent process to the end of its run; returns the last step. report: gets "joined", then "began"."""
    with Node(identity) as node:
        briefing = brief(node)
        text, scenario, agent = briefing.text, briefing.scenario, int(identity.name)
        if agent >= scenario.count:
            raise UserError(f"run {identity.run!r} has agents 0 to {scenario.count - 1}, no agent {agent}")
        node.claim_name()
        report("joined")
        succession = Succession(node.presence, node.stop)
        process = Agent(node, briefing.plan, agent)
        require(links=len(process.neighbourhood.ids) + 1 + scenario.record.awaited)
        if text.faults:
            process.inject(text.faults)
        node.presence.enter(f"agent/{identity.name}")
        process.vicinity.step = text.step or 0
        Links(node, process.vicinity).keep()
        entry = Entrance(process, None if text.step is None else text.agents, briefing.clock).wait()
        if entry is not None:
            report("began")
        last = 0 if entry is None else process.run(entry)
        if succession.replaced:
            # Another process may have this agent's name by now: no more words in it.
            node.presence.withdraw()
            Ending("again").tell()
            raise UserError(
                f"the target of run {identity.run!r} was started again, so the run of agent {agent} is over after step "
                f"{last}; start the agent again, too"
            )
        process.finish(last)
        node.presence.leave(f"agent/{identity.name}")
    return last
