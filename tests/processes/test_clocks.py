"""Hosts whose clocks are an hour apart."""

import os
from pathlib import Path

import pytest

from tests.processes.conftest import settings

SHIFTED = """import time
shift = {shift}
wall, wall_ns = time.time, time.time_ns
time.time = lambda: wall() + shift
time.time_ns = lambda: wall_ns() + shift * 1_000_000_000
"""


@pytest.mark.parametrize("shift", [-3600, 3600])
def test_an_agent_whose_clock_is_an_hour_off_takes_part_in_realtime(world, free_port, shift):
    (world.folder / "sitecustomize.py").write_text(SHIFTED.format(shift=shift))
    path = os.pathsep.join([str(world.folder), str(Path.cwd())])
    endpoint = f"tcp/127.0.0.1:{free_port}"
    join = ["--run", world.run, "--connect", endpoint, "--patience", "20"]
    overrides = settings("steps=20", "timing.mode=realtime", "timing.patience=2", "dt=0.1")
    processes = [world.start("target", "tracking", *overrides, "--run", world.run, "--listen", endpoint)]
    processes.append(world.start("record", *join, "--output", str(world.log)))
    for agent in range(4):
        prefix = ["env", f"PYTHONPATH={path}"] if agent == 1 else []
        processes.append(world.start("agent", str(agent), *join, prefix=prefix))
    for process in processes:
        out, err = process.communicate(timeout=100)
        assert process.returncode == 0, err
        assert "after step 20" in out or "messages in" in out
