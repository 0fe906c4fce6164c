"""Agents that link to those in range while the run goes on: by hand, in lockstep, where no message may be missed."""

import numpy as np
import pytest

from tests.processes.conftest import World, ended, unused_endpoint
from zenoh_cbef.nodes.agent.vicinity import Vicinity
from zenoh_cbef.scenario.load import parse, to_toml
from zenoh_cbef.scenario.network import in_range
from zenoh_cbef.scenario.plan import Plan

# The third agent is far from both others for longer than links are made beforehand, and are kept.
AWAY = {
    "steps": 250,
    "agents": {
        "motion": "waypoints",
        "speed": 5.0,
        "waypoints": [[[0.0, 0.0, 0.0]], [[10.0, 0.0, 0.0]], [[-50.0, 2.0, 0.0], [60.0, 2.0, 0.0]]],
        "count": 3,
    },
    "network": {"graph": "radio", "radius": 10.5},
}


@pytest.mark.parametrize("agent", range(3))
def test_an_agent_links_before_it_is_in_range_and_keeps_links_for_a_while(agent: int) -> None:
    plan = Plan(parse(AWAY, "test"))
    others = [one for one in range(3) if one != agent]
    near, vicinity, changed = in_range(plan.scenario)[agent], Vicinity(plan, agent, others, follows=True), []
    vicinity.on_change = lambda: changed.append(vicinity.step)
    for step in range(1, 251):
        former = vicinity.wanted()
        vicinity.come(step)
        assert (former != vicinity.wanted()) == (step in changed)
        soon, lately = near[:, step - 1 : step + 30], near[:, max(0, step - 31) : step]
        assert vicinity.wanted() == {one for one in others if soon[one].any()}
        assert vicinity.kept() == {one for one in others if soon[one].any() or lately[one].any()}
        if step > 1:
            arriving = vicinity.arriving
            assert arriving is not None
            assert np.flatnonzero(arriving).tolist() == np.flatnonzero(near[:, step - 1] & ~near[:, step - 2]).tolist()
    assert len(changed) == {0: 2, 1: 2, 2: 4}[agent]
    assert Vicinity(plan, agent, others, follows=False).wanted() == set(others)


def test_a_lockstep_run_in_which_links_come_and_go_is_equal_bit_for_bit(world: World) -> None:
    (world.folder / "away.toml").write_text(to_toml(parse(AWAY, "test")))
    place = unused_endpoint()
    join = world.join(place)
    started = [
        world.start("target", "away.toml", "--run", world.run, "--listen", place, "--patience", "100"),
        world.start("record", *join, "--output", str(world.log)),
        *(world.start("agent", str(agent), *join) for agent in range(3)),
    ]
    for process in started:
        ended(process)
    assert world.verdict().startswith("equal bit for bit")
