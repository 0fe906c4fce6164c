"""Faults that are injected into a run while it goes on."""

import json
from typing import Any

import numpy as np

from tests.processes.conftest import ended
from tests.waiting import until
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.outside.registry import known_runs
from zenoh_cbef.simulator import simulate


def wait_until_after(world, seconds: float) -> None:
    """Wait until the run has come so far."""
    until(lambda: (world.status().get("time") or 0.0) >= seconds, "the run stands still", 200.0)


def test_faults_are_added_listed_and_cleared_while_the_run_goes_on(world):
    run = world.under_way("timing.mode=realtime", "steps=100000")

    def fault(*arguments: str, status: int = 0) -> str:
        done = world.done("fault", *arguments, "--run", world.run, status=status)
        assert "Traceback" not in done.stderr
        return done.stdout + done.stderr

    assert "nothing was injected" in fault("list")
    assert "fault 0 (loss)" in fault("add", "loss", "probability=0.5", "links=agent:1")
    assert "must be one of loss" in fault("add", "los", status=2)
    assert "a number from 0 to 1" in fault("add", "loss", "probability=2", status=2)
    assert "names agent 9" in fault("add", "outage", "agents=[9]", status=2)
    assert "is over" in fault("add", "outage", "agents=[0]", "from=0.1", status=2)
    assert "key=value" in fault("add", "loss", "probability", status=2)
    fault("add", "byzantine", "agents=[2]", "magnitude=3.0", "--for", "300")
    listed = json.loads(fault("list", "--json"))
    assert [(one["number"], one["kind"]) for one in listed] == [(0, "loss"), (1, "byzantine")]
    assert listed[0]["from"] < listed[1]["from"] == round(listed[1]["until"] - 300.0, 3)
    wait_until_after(world, listed[0]["from"] + 1.0)  # a loss into whose time no step falls is not told
    assert "ended fault 0" in fault("clear", "0")
    assert "no injected fault 7" in fault("clear", "7", status=2)
    [after, _] = json.loads(fault("list", "--json"))
    assert after["until"] > after["from"]
    wait_until_after(world, after["until"] + 0.3)

    run.terminate()
    ended(run, 130)
    assert world.run not in known_runs()
    for verb, *more in (["check"], ["timeline", "--steps", "5:6"], ["reestimate", "-o", str(world.folder / "a.mcap")]):
        world.done(verb, str(world.log), *more)
    assert_both_are_told(world)


def assert_both_are_told(world):
    """The log holds the loss of agent 1's links and the lie of agent 2, which a reader leaves out of averages."""
    trace = read_trace(world.log)
    events: list[Any] = list(trace.events)
    told = [(event["data"]["fault"], event["data"]["on"]) for event in events if event["kind"] == "fault"]
    assert told[:1] == [(0, True)]
    assert sorted(told[1:]) == [(0, False), (1, True)]
    links = trace.links
    touched = (links.source == 1) | (links.destination == 1)
    assert (links.injected_lost[touched] > 0).all()
    assert not links.injected_lost[~touched].any()
    # Who was made to lie is left out of the averages, as if the scenario had said so.
    [analysis] = analyze([trace])
    assert analysis.counted.tolist() == [True, True, False, True]
    assert analysis.metrics.position_rmse is not None


def test_in_lockstep_injected_faults_begin_with_a_step_for_all_and_the_log_is_proved_with_them(world):
    run = world.under_way("steps=100000")

    def fault(*arguments: str) -> str:
        done = world.done("fault", *arguments, "--run", world.run)
        return done.stdout

    def pass_by(moment: float) -> None:
        """Wait until the run has made all steps up to a moment of its own time."""

        def is_past() -> bool:
            told = world.status()
            return bool(told) and told["step"] * told["dt"] >= moment

        until(is_past, "the run stands still")

    fault("add", "loss", "probability=1", "links=agent:1")
    fault("add", "sensor-bias", "agents=[2]", "bias=3.0")
    # An agent that crashes with the first step of the loss would lose nothing.
    pass_by(json.loads(fault("list", "--json"))[0]["from"] + 1.0)
    fault("add", "crash", "agents=[0]", "--for", "2")
    fault("clear", "0")
    listed = json.loads(fault("list", "--json"))
    assert listed[0]["until"] > listed[0]["from"]
    unknown = world.done("fault", "list", "--run", "absent", status=2)
    assert "no run 'absent' goes on on this host (there " in unknown.stderr
    pass_by(listed[2]["until"] + 2.0)
    run.terminate()
    ended(run, 130)
    world.verdict()
    trace = read_trace(world.log)
    assert [fault.kind for fault in trace.scenario.fault] == ["loss", "sensor-bias", "crash"]
    assert np.isnan(trace.estimates[0]).any()
    assert (trace.links.injected_lost[trace.links.source == 1] > 0).all()
    # As a scenario it is the same run.
    again = simulate([trace.scenario.changed(steps=len(trace.time))])[0]
    assert np.array_equal(again.estimates, trace.estimates, equal_nan=True)
