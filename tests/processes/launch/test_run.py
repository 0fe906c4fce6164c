"""`run` from end to end: what it writes, and that processes and simulator compute the same bits."""

import json
import sys

import numpy as np
import pytest

from tests.processes.conftest import ended, settings

LOSS = 'fault=[{kind="loss",probability=0.4},{kind="delay",milliseconds=5,jitter_ms=40,from=1,until=3}]'


def test_a_run_leaves_log_scenario_metrics_report_figures_and_a_latest_link(world):
    done = world.done("run", "tracking", *settings(), "--run", world.run)
    folder = world.folder / "logs" / world.run
    assert (world.folder / "logs" / "latest").resolve() == folder.resolve()
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["run"] == world.run
    assert metrics["steps"] == 40
    assert metrics["messages"]["missing"] == metrics["messages"]["rejected"] == 0
    assert metrics["messages"]["recorded"] == metrics["messages"]["sent"] > 40 * 4 * 5
    assert (folder / "report.html").stat().st_size > 100_000
    assert {path.suffix for path in (folder / "figures").iterdir()} == {".png", ".svg"}
    assert "position RMSE" in done.stdout
    assert not world.wait_until_gone()
    repeated = world.call("sim", str(folder / "scenario.toml"), "--json")
    assert json.loads(repeated.stdout)["position_rmse"] == metrics["position_rmse"]


@pytest.mark.parametrize(
    "overrides",
    [
        (),
        ("filter.kind=icf", "consensus.acceleration=chebyshev", LOSS),
        ("filter.kind=cbef", "agents.low=0.0", "agents.high=0.8", "dt=0.01", LOSS),
        ("filter.kind=local",),
        (
            *("filter.planar_height=0.0", "agents.motion=formation", "agents.velocity=[0.2,0.0,0.0]"),
            *("sensor.dropout_probability=0.3", "consensus.weights=uniform", "network.graph=star"),
        ),
    ],
    ids=["sicf", "lossy-icf", "lossy-cbef", "local", "planar-moving-dropouts"],
)
def test_processes_and_simulator_give_the_same_bits(world, overrides):
    world.complete(*overrides)
    world.verdict()
    run, sim = world.folder / "run.npz", world.folder / "sim.npz"
    world.done("export", str(world.log), "--to", "npz", "--output", str(run))
    world.done("sim", "tracking", *settings(*overrides), "--output", str(sim))
    with np.load(run) as logged, np.load(sim) as simulated:
        assert set(logged) == set(simulated)
        for name in logged:
            assert logged[name].tobytes() == simulated[name].tobytes(), name


def test_a_realtime_run_keeps_to_the_clock_and_cannot_be_judged(world):
    overrides = ("timing.mode=realtime", "dt=0.05", "consensus.rounds=2")
    world.complete(*overrides)
    metrics = world.metrics()
    assert metrics["steps"] == 40
    assert metrics["timing"] == "realtime"
    assert "realtime" in world.verdict(2)


def test_single_processes_make_a_run_with_no_more_than_its_name_and_an_endpoint(world, endpoint):
    join = world.join(endpoint)
    target = world.start("target", "tracking", *settings(), "--run", world.run, "--listen", endpoint)
    agents = [world.start("agent", str(agent), *join) for agent in range(4)]
    recorder = world.start("record", *join, "--output", str(world.log))
    for process in (target, *agents, recorder):
        ended(process)
    world.verdict()


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_the_launcher_waits_for_a_recorder_only_if_one_is_required(world, endpoint):
    join = world.join(endpoint)
    quiet = settings("record.required=false")
    target = world.start("target", "tracking", *quiet, "--run", world.run, "--listen", endpoint)
    agents = [world.start("agent", str(agent), *join) for agent in range(4)]
    for process in (target, *agents):
        out, _ = ended(process)
        assert "after step 40" in out
