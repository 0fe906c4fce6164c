"""Cables, hosts, switches and the router fail in real time: the run goes on where it can, and all rejoin."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.protocol.slow import SLOW

DT = 0.2  # of which a busy machine needs the half
FOUND, STEPS = 35, 160
"""After how many steps the target is surely found, and how many there are."""
LAST = 15
"""In so many steps all take part again."""
REALTIME = ["timing.mode=realtime", f"dt={DT}", "network.graph=ring", "consensus.rounds=2"]
CLOSE = 1.0
"""Position error, m, of agents that track: ten times what undisturbed runs have."""
WAYS = ["router", "peers"]


@dataclass
class Outcome:
    """What the log says. error: position error (agents, steps), m, NaN where no estimate was recorded.

    slow: whether the host did not keep up: agents whose rounds come too late do not track without a disturbance either.
    """

    error: np.ndarray
    said: list[tuple[str, str]]
    slow: bool

    def tracks(self, agents, first: int, last: int | None = None, share: float = 0.9) -> bool:
        """Whether these agents have close estimates in (nearly) all of these steps, if the host kept up."""
        chosen = self.error[list(agents), first:last]
        return self.slow or float(np.mean(chosen < CLOSE)) >= share

    def missing(self, agent: int) -> int:
        return int(np.isnan(self.error[agent]).sum())


def outcome(world, steps: int = STEPS) -> Outcome:
    trace = read_trace(world.log)
    size = (len(trace.estimates), steps)
    error = np.full(size, np.nan)
    found = np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2)
    error[:, : found.shape[1]] = found[:, :steps]
    events: list[Any] = list(trace.events)
    said = [(event["kind"], event.get("data", {}).get("name", "")) for event in events]
    return Outcome(error, said, SLOW in dict(said))


def under_way(run, steps: int = STEPS) -> None:
    run.start(*REALTIME, steps=steps)
    run.world.wait_for_messages()
    time.sleep(FOUND * DT)


def test_a_cable_is_out_for_five_seconds_and_then_the_recorders(site, lab, world):
    run, steps = site("peers"), STEPS + 20
    under_way(run, steps)
    for host in ("a3", "record"):
        lab.link(host, up=False)
        time.sleep(5)
        lab.link(host, up=True)
        time.sleep(4)
    run.finish()
    found = outcome(world, steps)
    assert found.tracks([0, 1, 2, 4, 5], FOUND)
    # What the recorder could not hear, of agent 3 and then of all, it asked for afterwards.
    assert max(found.missing(agent) for agent in range(6)) == 0
    world.done("check", str(world.log))
    assert found.tracks([3], STEPS - LAST)
    assert {(kind, who) for kind in ("left", "returned") for who in ("agent/3", "target/target")} <= set(found.said)


def test_a_host_is_gone_for_good(site, lab, world):
    run = site("router")
    under_way(run)
    lab.link("a2", up=False)
    lab.kill("a2")
    run.finish(["target", "record", "a0", "a1", "a3", "a4", "a5"])
    found = outcome(world)
    assert found.tracks([0, 1, 3, 4, 5], FOUND)
    assert found.missing(2) > 40
    assert ("left", "agent/2") in found.said
    assert ("returned", "agent/2") not in found.said


@pytest.mark.parametrize("way", WAYS)
def test_a_network_falls_into_halves_and_heals(site, lab, world, way):
    run = site(way)
    under_way(run)
    lab.partition(["a3", "a4", "a5"])
    time.sleep(5)
    lab.partition([])
    run.finish()
    found = outcome(world)
    assert found.tracks([0, 1, 2], FOUND)
    assert found.tracks(range(6), STEPS - LAST)
    for agent in (3, 4, 5):
        assert found.missing(agent) == 0
        assert ("left", f"agent/{agent}") in found.said
        assert ("returned", f"agent/{agent}") in found.said


def test_the_router_is_killed_and_started_again(site, lab, world):
    run = site("router")
    under_way(run)
    lab.kill("router")
    time.sleep(3)
    run.start_router()
    run.finish()
    found = outcome(world)
    assert max(found.missing(agent) for agent in range(6)) == 0
    assert found.tracks(range(6), STEPS - LAST)
    assert {("left", "target/target"), ("returned", "target/target")} <= set(found.said)


def test_the_recorders_host_is_gone_for_good(site, lab, world):
    run = site("peers")
    under_way(run)
    lab.link("record", up=False)
    lab.kill("record")
    run.finish(["target", *(f"a{agent}" for agent in range(6))])
    world.log.with_name(world.log.name + ".active").rename(world.log)
    assert outcome(world).tracks(range(6), 20, FOUND)
