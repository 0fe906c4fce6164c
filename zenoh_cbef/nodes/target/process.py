"""The target process, from its start to its end."""

from __future__ import annotations

from collections.abc import Callable

from zenoh_cbef import __version__
from zenoh_cbef.machine import require
from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.nodes.target.services import served
from zenoh_cbef.nodes.target.target import Target
from zenoh_cbef.outside.registry import registered
from zenoh_cbef.protocol.scenario_service import ScenarioText
from zenoh_cbef.scenario.load import Loaded, to_toml
from zenoh_cbef.scenario.size import refuse_too_many_processes
from zenoh_cbef.scenario.world import World, make_world


def run_target(
    identity: Identity,
    loaded: Loaded,
    world: World | None = None,
    *,
    receivers: bool = False,
    wait_for: int | None = None,
    report: Callable[[str], None] | None = None,
) -> int:
    """Run the target process of a scenario to its end; returns the last step.

    world: what is measured, None for what the scenario says. receivers, wait_for, report: see Target.
    """
    refuse_too_many_processes(loaded.scenario)
    require(links=loaded.scenario.count + loaded.scenario.record.awaited)
    with Node(identity) as node:
        node.refuse_twin()
        emulated = make_world(loaded.scenario) if world is None else world
        how = {"recorded": world is not None, "receivers": receivers}
        target = Target(node, loaded.plan, emulated, **how, wait_for=wait_for, report=report)
        resolved = to_toml(loaded.scenario)

        def text() -> ScenarioText:
            injected = "" if target.injection is None else target.injection.tables()
            # Where the target does not wait for all, every agent joins as if the run were under way.
            step = target.step if target.step is not None or wait_for is None else 0
            members = () if target.step is None else tuple(target.members())
            return ScenarioText(loaded.source, resolved, __version__, step, members, injected)

        reached = [*identity.connection.listen, *identity.connection.connect]
        with served(target, text):
            node.presence.enter(f"target/{identity.name}")
            with registered(identity.run, reached, launched=node.launched):
                target.wait_for_agents(identity.patience)
                last = 0 if node.stopping else target.run()
        node.presence.leave(f"target/{identity.name}")
    return last
