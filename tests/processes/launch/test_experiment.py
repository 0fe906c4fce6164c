"""An experiment whose runs are processes gives what the simulated one gives."""

import csv
from pathlib import Path

from tests.processes.conftest import World

SMALL = """
seeds = 1
engine = "processes"
[set]
steps = 10
"agents.count" = 3
"network.graph" = "ring"
[[fault]]
kind = "loss"
probability = 0.2
[[vary]]
key = "consensus.rounds"
values = [2]
[[expect]]
metric = "messages.sent"
at_least = 1
"""


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "results.csv").open() as stream:
        return list(csv.DictReader(stream))


def test_processes_and_simulation_agree_to_the_last_digit(world: World):
    for name, engine in (("processes", "processes"), ("simulate", "simulate")):
        (world.folder / f"{name}.toml").write_text(SMALL.replace('"processes"', f'"{engine}"'))
        done = world.call("experiment", f"{name}.toml", "-o", name, "--jobs", "1")
        assert done.returncode == (0 if engine == "processes" else 1), done.stderr
    (ran,), (simulated,) = rows_of(world.folder / "processes"), rows_of(world.folder / "simulate")
    for metric in ("position_rmse", "ratio_to_centralized", "disagreement", "nees.average", "links.lost"):
        assert ran[metric] == simulated[metric]
    # A simulation sends nothing; its bytes are those of the messages without the fates that a lossy run also reports.
    assert 1.0 < float(ran["bytes_per_step"]) / float(simulated["bytes_per_step"]) < 1.2
    assert list((world.folder / "processes" / "logs").glob("*/run.mcap"))
