"""Hosts whose clocks are an hour apart."""

import os
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.processes.conftest import ended, settings, unused_endpoint
from zenoh_cbef.nodes.agent.entrance import Entrance
from zenoh_cbef.nodes.common.node import Identity
from zenoh_cbef.protocol.scenario_service import Clock, ScenarioText, serve_scenario
from zenoh_cbef.protocol.session import Connection, open_session

SHIFTED = """import time
shift = {shift}
wall, wall_ns = time.time, time.time_ns
time.time = lambda: wall() + shift
time.time_ns = lambda: wall_ns() + shift * 1_000_000_000
"""


@pytest.mark.parametrize("shift", [-3600, 3600])
def test_an_agent_whose_clock_is_an_hour_off_takes_part_in_realtime(world, endpoint, shift):
    (world.folder / "sitecustomize.py").write_text(SHIFTED.format(shift=shift))
    path = os.pathsep.join([str(world.folder), str(Path.cwd())])
    join = world.join(endpoint)
    overrides = settings("steps=20", "timing.mode=realtime", "timing.patience=2", "dt=0.1")
    processes = [world.start("target", "tracking", *overrides, "--run", world.run, "--listen", endpoint)]
    processes.append(world.start("record", *join, "--output", str(world.log)))
    for agent in range(4):
        prefix = ["env", f"PYTHONPATH={path}"] if agent == 1 else []
        processes.append(world.start("agent", str(agent), *join, prefix=prefix))
    for process in processes:
        out, _ = ended(process)
        assert "after step 20" in out or "messages in" in out


@pytest.mark.parametrize("jump", [-3600.0, 3600.0])
def test_a_clock_that_is_set_after_an_agent_has_joined_does_not_move_the_start(jump):
    endpoint = unused_endpoint()
    joined = Clock(ahead=jump, round_trip=0.001)  # then the target's clock was set right
    with open_session(Connection(listen=[endpoint])) as target, open_session(Connection([endpoint])) as session:
        service = serve_scenario(target, "test", lambda: ScenarioText("", "", ""))
        node = SimpleNamespace(session=session, identity=Identity("test", "agent", "1"))
        entrance = Entrance(SimpleNamespace(node=node, neighbourhood=None), None, joined)
        now, before = time.time(), time.monotonic()
        epoch = entrance.epoch(now + 100.0, int(1e9 * now))
        assert abs(epoch - before - 100.0) < 0.5 * abs(jump)
        service.undeclare()
