"""A run that goes on is looked at and ended from outside."""

import json
import os
import signal
import time
from typing import Any

import pytest

from tests.processes.conftest import ended, settings
from zenoh_cbef import __version__
from zenoh_cbef.log.read.trace import read_trace


def wait_for(world, condition, *options: str) -> dict:
    """The first status that fulfils the condition; on a busy machine a run may not answer at once."""
    until = time.monotonic() + 100
    while True:
        told = world.call("status", "--run", world.run, "--json", *options)
        if told.returncode == 0 and condition(status := json.loads(told.stdout)):
            return status
        assert time.monotonic() < until, (told.stdout, told.stderr)


def test_status_tells_who_is_where_and_how_well_they_track(world):
    run = world.under_way("timing.mode=realtime", "dt=0.4", "steps=5000")
    status = wait_for(
        world,
        lambda one: all(agent["step"] for agent in one["agents"]) and all(link["received"] for link in one["links"]),
    )
    assert (status["run"], status["mode"], status["state"], status["steps"]) == (world.run, "realtime", "running", 5000)
    assert status["step"] > 0
    for agent in status["agents"]:
        where = agent["where"]
        assert where["pid"] == world.pid_of(f"agent {agent['agent']}")
        assert (where["host"], where["version"]) == (os.uname().nodename, __version__)
        assert abs(where["clock"]) <= where["round_trip"], "one host has one clock"
        assert agent["state"] == "on"
        assert 0.0 < agent["error"] < 10.0
        assert 0.0 < agent["spread"] < 10.0
    assert status["target"]["pid"] == world.pid_of("target")
    assert status["recorder"]["pid"] == world.pid_of("record")
    assert 0.0 < status["disagreement"] < 10.0
    ends = {(link["source"], link["destination"]) for link in status["links"]}
    assert ends == {(one, (one + step) % 4) for one in range(4) for step in (1, 3)}
    assert status["faults"] == []
    health = {who: world.call("health", who, "--run", world.run) for who in ("target", "record", "agent/1", "agent/7")}
    assert [one.returncode for one in health.values()] == [0, 0, 0, 1], "it finds the runs that status finds"

    early = status["agents"]
    world.done("fault", "add", "outage", "agents=[2]", "--run", world.run)
    status = wait_for(world, lambda one: one["faults"])
    assert [(one["kind"], one["agents"]) for one in status["faults"]] == [("outage", [2])]
    status = wait_for(world, lambda one: any(link["lost"] for link in one["links"]))
    assert all(2 in (link["source"], link["destination"]) for link in status["links"] if link["lost"])

    os.kill(world.pid_of("agent 1"), signal.SIGKILL)
    status = wait_for(world, lambda one: one["agents"][1]["state"] == "gone")
    table = world.call("status", "--run", world.run)
    assert "not here: agent 1" in table.stdout
    world.done("health", "agent/1", "--run", world.run, status=1)

    stopped = world.done("stop", "--run", world.run)
    assert "ends after its present step" in stopped.stdout
    run.communicate(timeout=100)
    assert_the_log_holds(world, early, status)


def assert_the_log_holds(world, early, status):
    """What status said of agents early in the run, and of where they are."""
    trace = read_trace(world.log)
    events: list[Any] = list(trace.events)
    here = {event["from"]: event["data"] for event in events if event["kind"] == "here"}
    assert here["agent/3"]["pid"] == status["agents"][3]["where"]["pid"]
    for agent in early:
        place = (agent["agent"], agent["step"] - 1)
        difference = trace.estimates[place][:3] - trace.truth[agent["step"] - 1][:3]
        assert agent["error"] == pytest.approx((difference**2).sum() ** 0.5, rel=1e-12)
        assert agent["nis"] == trace.diagnostics.nis[place]


def test_a_stopped_run_in_lockstep_still_verifies(world):
    run = world.under_way("steps=100000")
    done = world.done("stop", "--run", world.run)
    assert done.stdout.splitlines()[-1] == f"run {world.run} has ended"
    run.communicate(timeout=100)
    assert world.verdict().startswith("equal bit for bit")
    gone = world.done("stop", "--run", world.run, status=2)
    assert f"no run {world.run!r} goes on on this host" in gone.stderr


def test_a_run_that_waits_for_its_agents_tells_whom_it_lacks(world, endpoint):
    target = world.start("target", "tracking", *settings(), "--run", world.run, "--listen", endpoint)
    world.wait_until_known()
    agent = world.start("agent", "1", "--run", world.run, "--connect", endpoint, "--patience", "100")
    there = ["--connect", endpoint]
    status = wait_for(world, lambda one: one["agents"][1]["state"] != "missing", *there)
    assert (status["state"], status["step"], status["recorder"]) == ("waiting", None, None)
    assert [one["state"] for one in status["agents"]] == ["missing", "linking", "missing", "missing"]
    done = world.done("stop", "--run", world.run, *there)
    assert "before its first step" in done.stdout
    target.communicate(timeout=100)
    agent.terminate()


def test_with_certificates_the_operators_is_asked_for(world):
    world.done("certs", "new", "certificates", "--agents", "4")
    run = world.under_way("timing.mode=realtime", "dt=0.1", "steps=5000", "zenoh.tls=certificates")
    status = wait_for(world, lambda one: all(agent["step"] for agent in one["agents"]), "--tls", "certificates")
    assert all(agent["where"]["pid"] for agent in status["agents"])
    refused = world.done("status", "--run", world.run, status=2)
    assert len(refused.stderr.splitlines()) == 1
    (world.folder / "certificates" / "operator.pem").write_bytes(
        (world.folder / "certificates" / "agent-1.pem").read_bytes()
    )
    (world.folder / "certificates" / "operator.key").write_bytes(
        (world.folder / "certificates" / "agent-1.key").read_bytes()
    )
    world.done("stop", "--run", world.run, "--tls", "certificates", status=2)  # an agent may not end the run
    run.send_signal(signal.SIGINT)
    ended(run, 130)
