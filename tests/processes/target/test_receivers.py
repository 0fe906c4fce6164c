"""Real receivers in place of the target's beacons: the documentation's own example."""

import math
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
from mcap.reader import make_reader

from tests.processes.conftest import ended
from tests.waiting import until
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.protocol.slow import SLOW

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "hosts.md").read_text(encoding="utf-8")


def block(language: str, begins: str) -> str:
    (found,) = [
        text for text in re.findall(rf"^```{language}\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE) if begins in text
    ]
    return found


def wait_for_subscribers(run: str, router: str) -> None:
    """Wait until all receivers listen for the start signal."""
    with open_session(Connection([router], mode="client")) as session:
        # Zenoh's stubs take a matching status for a bool.
        publishers: list[Any] = [session.declare_publisher(f"cbef/{run}/beacon/{agent}/signal") for agent in range(4)]
        until(lambda: all(publisher.matching_status.matching for publisher in publishers))


PROGRAM = block("python", "measured_range")
ON_TIME = 'time.sleep(max(0.0, start["at"] + emitted - time.time()))'


def feed(world, free_port, program):
    """Complete the documented run with receivers that run a program."""
    (world.folder / "live.toml").write_text(block("toml", 'name = "live"'))
    path = world.folder / "receiver.py"
    path.write_text(program)
    router = f"tcp/127.0.0.1:{free_port}"
    join = ["--run", world.run, "--client", "--connect", router]
    started = world.start("router", "--listen", router)
    assert started.stdout.readline()
    receivers = [subprocess.Popen([sys.executable, path, world.run, router, str(agent)]) for agent in range(4)]
    try:
        wait_for_subscribers(world.run, router)
        processes = [world.start("record", *join, "--patience", "100", "--output", str(world.log))]
        processes += [world.start("agent", str(agent), *join, "--patience", "100") for agent in range(4)]
        processes.append(world.start("target", "live.toml", *join, "--receivers"))
        for process in processes:
            ended(process)
        assert [receiver.wait(100) for receiver in receivers] == [0] * 4
    finally:
        for receiver in receivers:
            receiver.kill()
            receiver.wait()


def test_the_documented_receiver_feeds_a_run(world, free_port):
    assert len([line for line in PROGRAM.splitlines() if line.strip()]) <= 35
    feed(world, free_port, PROGRAM)
    world.done("export", str(world.log), "--output", "live.npz")
    estimates = np.load(world.folder / "live.npz")["estimates"]
    seconds = 0.1 * np.arange(1, 101)
    truth = np.array([[4.0 + math.cos(t), 3.0 + math.sin(t), 1.0] for t in seconds])
    error = np.linalg.norm(estimates[:, :, :3] - truth, axis=2)
    if any(event["kind"] == SLOW for event in read_trace(world.log).events):
        return  # where rounds come too late, as on a busy machine, agents do not track
    assert np.nanmedian(error[:, 50:]) < 0.5


def test_no_agent_begins_a_step_long_before_its_time_because_its_beacon_is_early(world, free_port):
    assert ON_TIME in PROGRAM
    feed(world, free_port, PROGRAM.replace(ON_TIME, "time.sleep(0.001 if k <= 100 else 0.1)"))
    dt, slot, begin, told = 0.1, 0.1 / 6, math.inf, 0
    with world.log.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            said = msgpack.unpackb(message.data)
            if channel.topic.endswith("/estimate"):
                told += 1
                assert message.publish_time * 1e-9 > begin + dt * said["k"] - slot - 0.01
            elif said.get("signal") == "start":
                begin = min(begin, said["at"])
    assert told > 100
