"""An agent that is there but says nothing is waited for, then left behind."""

from tests.processes.conftest import ended, outsider, settings


def test_a_mute_agent_holds_the_others_up_only_as_long_as_their_patience(world, endpoint):
    overrides = settings("steps=12", "agents.count=3", "network.graph=complete", "timing.patience=2")
    join = world.join(endpoint)
    target = world.start("target", "tracking", *overrides, "--run", world.run, "--listen", endpoint)
    others = [world.start("agent", str(agent), *join) for agent in range(2)]
    others.append(world.start("record", *join, "--output", str(world.log)))
    live = f"cbef/{world.run}/live"
    with outsider(endpoint) as session:
        tokens = [session.liveliness().declare_token(f"{live}/{name}") for name in ("agent/2", "ready/2")]
        ended(target)
        for token in tokens:
            token.undeclare()
        for process in others:
            ended(process)
    metrics = world.metrics()
    assert metrics["steps"] == 12
    for link in metrics["links"]:
        if link["source"] == 2:
            assert (link["delivered"], link["lost"]) == (0, 36)
        elif link["destination"] != 2:
            assert (link["delivered"], link["lost"]) == (36, 0)
    assert "agent/2 is there but silent" in world.verdict(2)
