"""Agents that are killed from outside and started again take part in the run that goes on."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from tests.processes.conftest import World, ended, settings
from tests.waiting import until
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.trace import Trace


def command_of(pid: int) -> list[str]:
    # A fork's words stand in the room that its parent's had, with zeros or blanks between them.
    words = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode().split()
    return words[words.index("zenoh_cbef") + 1 :]


def kill_and_start_again(world: World, agent: int) -> None:
    pid = world.pid_of(f"agent {agent}")
    command = command_of(pid)
    os.kill(pid, signal.SIGKILL)
    time.sleep(0.3)
    world.start(*command)


def wait_for_estimates(world: World, agent: int) -> None:
    def told() -> int:
        topics = [one.channel.topic for one in open_log(world.log).messages()]
        return sum(topic.endswith(f"agent/{agent}/estimate") for topic in topics)

    until(lambda: told() >= 10, f"agent {agent} did not take part", every=0.2)


def joined(trace: Trace) -> dict:
    [data] = [event["data"] for event in trace.events if event["kind"] == "joined"]
    assert isinstance(data, dict)
    return data


def wait_until_it_is_back(world: World, agent: int, steps: int) -> None:
    """Wait until an agent has taken part in so many steps since it joined; how soon it joins depends on the host."""

    def is_back() -> bool:
        told = world.status()
        joined = [one["data"]["step"] for one in told.get("events", []) if one["kind"] == "joined"]
        return bool(joined) and (told["agents"][agent]["step"] or 0) > joined[0] + steps

    until(is_back, f"agent {agent} did not take part", 200.0, every=0.1)


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_an_agent_that_was_killed_takes_part_again(world, mode):
    run = world.under_way("steps=100000", f"timing.mode={mode}", "network.graph=complete", size=30_000)
    kill_and_start_again(world, 2)
    wait_until_it_is_back(world, 2, 25)
    world.done("stop", "--run", world.run)
    _, err = ended(run, 1)
    assert "agent 2 was killed by signal 9" in err
    assert "Traceback" not in err
    trace = read_trace(world.log)
    told = joined(trace)
    assert (told["agent"], told["planned"]) == (2, False)
    first = told["step"] - 1
    assert np.isnan(trace.estimates[2, first - 1]).all()
    assert np.isfinite(trace.estimates[2, first + 1 : first + 25]).all()
    error = np.linalg.norm(trace.estimates[:, :, :3] - trace.truth[:, :3], axis=2)
    others = np.delete(error, 2, axis=0)[:, first + 20]
    if mode == "lockstep":
        assert error[2, first + 20] <= 1.1 * others.max()
    world.verdict(2)


def test_a_run_starts_with_some_and_the_others_join_later(world, endpoint):
    join = world.join(endpoint)
    overrides = settings("timing.mode=realtime", "steps=100000", "network.graph=complete")
    listen = ["--listen", endpoint, "--wait-for", "3"]
    target = world.start("target", "tracking", *overrides, "--run", world.run, *listen)
    others = [world.start("agent", str(agent), *join) for agent in (0, 2, 3)]
    others.append(world.start("record", *join, "--output", str(world.log)))
    world.wait_for_messages(20_000)
    others.append(world.start("agent", "1", *join))
    wait_for_estimates(world, agent=1)
    target.terminate()
    for process in (target, *others):
        ended(process)
    trace = read_trace(world.log)
    told = joined(trace)
    assert (told["agent"], told["planned"]) == (1, False)
    there = np.isfinite(trace.estimates[:, :, 0])
    assert there[[0, 2, 3], 0].all()
    assert not there[1, : told["step"] - 1].any()
    assert there[1, told["step"] : told["step"] + 5].all()


def test_in_lockstep_the_scenario_says_who_is_there(world):
    done = world.done("target", "tracking", "--run", world.run, "--wait-for", "3", status=2)
    assert "--wait-for needs timing.mode = 'realtime'" in done.stderr
