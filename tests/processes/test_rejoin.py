"""Agents that are killed from outside and started again take part in the run that goes on."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from tests.processes.conftest import World
from zenoh_cbef.log.read_trace import read_trace
from zenoh_cbef.trace import Trace


def command_of(pid: int) -> list[str]:
    words = Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")[:-1]
    return words[words.index("zenoh_cbef") + 1 :]


def kill_and_start_again(world: World, agent: int) -> None:
    pid = world.pid_of(f"agent {agent}")
    command = command_of(pid)
    os.kill(pid, signal.SIGKILL)
    time.sleep(0.3)
    world.start(*command)


def joined(trace: Trace) -> dict:
    [event] = [event for event in trace.events if event["kind"] == "joined"]
    return event["data"]


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_an_agent_that_was_killed_takes_part_again(world, mode):
    steps = {"lockstep": "steps=1500", "realtime": "steps=100"}[mode]
    run = world.start_run(steps, f"timing.mode={mode}", "network.graph=complete")
    world.wait_for_messages(30_000)
    kill_and_start_again(world, 2)
    _, err = run.communicate(timeout=120)
    assert run.returncode == 1
    assert "agent 2 was killed by signal 9" in err
    assert "Traceback" not in err
    trace = read_trace(world.log)
    told = joined(trace)
    assert (told["agent"], told["planned"]) == (2, False)
    first = told["step"] - 1
    assert np.isnan(trace.estimates[2, first - 1]).all()
    assert np.isfinite(trace.estimates[2, first + 1 :]).all()
    error = np.linalg.norm(trace.estimates[:, :, :3] - trace.truth[:, :3], axis=2)
    others = np.delete(error, 2, axis=0)[:, first + 20]
    if mode == "lockstep":
        assert error[2, first + 20] <= 1.1 * others.max()
    verdict = world.call("verify", str(world.log))
    assert verdict.returncode == 2
    assert "Traceback" not in verdict.stderr
