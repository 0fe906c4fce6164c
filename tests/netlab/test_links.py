"""Agents that know the target's endpoint alone link along the graph, and to no other process: counted from sockets."""

import json
import subprocess
import time

import numpy as np
import pytest

from tests.netlab.conftest import AGENTS
from tests.waiting import until
from zenoh_cbef.scenario.load import load

REALTIME = ["timing.mode=realtime", "dt=0.1"]


def counted(lab) -> list[int]:
    """The links of each agent's host, on which there is no other process."""
    words = ["ss", "-tnH", "state", "established"]
    hosts = [lab.command(f"a{agent}", words) for agent in range(AGENTS)]
    return [len(subprocess.run(one, capture_output=True, text=True, check=True).stdout.splitlines()) for one in hosts]


def settle(lab, wanted: list[int]) -> None:
    until(lambda: counted(lab) == wanted, every=0.2)


def wait_until_told(run, lab, *, carried: bool) -> None:
    """Wait until the run's status says so of the two agents that do not reach each other, and that both hear others."""
    words = ["status", "--run", run.world.run, "--connect", run.endpoint("target"), "--json"]
    until = time.monotonic() + 100
    while time.monotonic() < until:
        done = run.world.call(*words, prefix=lab.command("record", []))
        found = json.loads(done.stdout) if done.returncode == 0 else {"apart": done.stderr, "links": []}
        heard = {(one["source"], one["destination"]): one["received"] for one in found["links"]}
        as_said = found["apart"] == [{"first": "agent/0", "second": "agent/1", "carried": True}] * carried
        if as_said and heard.get((0, 1)) and heard.get((1, 0)):
            return
        time.sleep(0.2)
    pytest.fail(f"status says {found['apart']}, {heard}")


def test_links_are_those_of_the_graph_also_when_agents_leave_and_come_back_or_do_not_reach_each_other(site, lab):
    run = site("peers")
    # Neighbours. What one tells the other goes by way of the target, over a second link of each to it.
    lab.part("a0", "a1")
    everywhere = f"{run.scheme}/0.0.0.0:0"
    own = run.endpoint
    run.endpoint = lambda host: own(host) if host in {"target", "record"} else everywhere
    run.start(*REALTIME, steps=5000)  # longer than a busy machine needs for what follows
    degrees = np.bincount(load("tracking", []).plan.edges.ravel(), minlength=AGENTS)
    wanted = [int(degree) + 2 for degree in degrees]
    run.world.wait_for_messages()
    settle(lab, wanted)
    wait_until_told(run, lab, carried=True)
    lab.part("a0", "a1", on=False)
    wait_until_told(run, lab, carried=False)
    settle(lab, wanted)
    for agent in (2, 5):
        lab.kill(f"a{agent}")
        run.start_agent(agent)
    settle(lab, wanted)
    words = ["stop", "--run", run.world.run, "--connect", run.endpoint("target")]
    run.world.call(*words, prefix=lab.command("record", []))
    run.finish()
