"""Faulty runs as processes: the bits and the fates of the simulator, stated in the log and proved by verify."""

from dataclasses import replace
from typing import Any

import numpy as np
import tomli_w
from hypothesis import HealthCheck, given

from tests.examples import examples
from tests.faults.strategies import scenarios
from tests.processes.again import again, said
from tests.processes.conftest import World
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.results import Metrics
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

EVERY_KIND = {
    "steps": 30,
    "agents": {"count": 4},
    "network": {"graph": "ring"},
    "consensus": {"rounds": 3},
    "fault": [
        {"kind": "burst-loss", "good_to_bad": 0.1, "bad_to_good": 0.4},
        {"kind": "corrupt", "probability": 0.15},
        {"kind": "duplicate", "probability": 0.2},
        {"kind": "reorder", "probability": 0.1, "links": {"between": [[0], [1, 2]]}},
        {"kind": "delay", "milliseconds": 4.0, "distribution": "normal", "std_ms": 5.0, "reorder": False, "until": 1.0},
        {"kind": "outage", "agents": [3], "from": 1.0, "until": 2.0},
        {"kind": "rate-limit", "messages_per_second": 25.0, "links": "agent:0"},
        {"kind": "partition", "links": {"between": [[0, 1], [2, 3]]}, "from": 2.0, "until": 2.5},
        {"kind": "sensor-stuck", "agents": [1], "from": 2.0},
        {"kind": "clock", "offset": 1e-9},
    ],
}


def run(world: World, scenario: dict) -> Metrics:
    """Run a scenario as processes, prove its log, and give its metrics, which must be the simulator's."""
    path = world.folder / "scenario.toml"
    path.write_text(tomli_w.dumps(scenario))
    world.done("run", str(path), "--run", world.run, "--log", str(world.log), "--no-report")
    verdict = verify(world.log)
    assert verdict.result == "equal", verdict.text
    traces = [read_trace(world.log), *simulate([load(str(path)).scenario])]
    metrics, simulated = (one.metrics for one in analyze(traces))
    assert [replace(link, latency=None) for link in metrics.links] == simulated.links
    assert metrics.position_rmse == simulated.position_rmse
    assert metrics.messages.missing == 0
    assert metrics.messages.rejected == sum(link.corrupted for link in metrics.links)
    return metrics


# Chebyshev's rounds overshoot, so honest agents come to the bound on what may be sent after the liars.
FLOOD_OF_LIES = {
    "steps": 2,
    "agents": {"count": 3},
    "network": {"graph": "complete"},
    "consensus": {"rounds": 40, "acceleration": "chebyshev", "bounds": [-0.9, 0.9]},
    "fault": [{"kind": "byzantine", "agents": [0, 1], "mode": "scale", "magnitude": 1e7}],
}


def test_what_liars_lead_an_honest_agent_to_send_is_bounded_as_in_the_simulator(world):
    assert run(world, FLOOD_OF_LIES).messages.rejected == 0


def test_silent_agents_give_the_simulators_bits(world):
    stage = {"rounds": 4, "precision": "int12", "trigger": 0.3}
    run(world, EVERY_KIND | {"consensus": stage})
    silent = read_trace(world.log).diagnostics.silent
    assert (silent[:, 10:] > 0.0).any()
    assert (silent[:, 10:] < 3.0).any()


def test_receivers_that_say_zero_are_heard_as_in_the_simulator(world):
    near = {"count": 5, "low": -3.0, "high": 3.0}
    biased = {"seed": 1018, "steps": 30, "agents": near, "sensor": {"bias_std": 3.0}}
    assert run(world, biased).messages.rejected == 0
    assert np.isnan(read_trace(world.log).ranges).any()


@examples(2, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(scenario=scenarios())
def test_random_faulty_scenarios_run_as_processes_and_verify(tmp_path_factory, scenario):
    world = World(tmp_path_factory.mktemp("faulty"))
    try:
        run(world, scenario)
    finally:
        world.end()


def test_messages_of_the_step_before_give_the_simulators_bits(world):
    fault = [
        {"kind": "delay", "milliseconds": 80.0, "distribution": "exponential"},
        {"kind": "loss", "probability": 0.1},
        {"kind": "sensor-bias", "bias": 4.0, "agents": [1], "from": 3.0, "until": 5.0},
    ]
    network = {"agents": {"count": 5}, "network": {"graph": "complete"}, "consensus": {"rounds": 1, "lag": 1}}
    metrics = run(world, {**network, "filter": {"kind": "ci"}, "steps": 60, "fault": fault})
    assert 0 < sum(link.late for link in metrics.links) < sum(link.delivered for link in metrics.links)
    assert metrics.distrust is not None
    assert (metrics.distrust.agents[1] or 0.0) > 0.0


def test_a_killed_and_a_stopped_process_come_back_and_the_bits_are_the_simulators(world):
    fault = [
        {"kind": "crash", "agents": [1], "from": 1.0, "until": 2.0},
        # Shorter than the target runs ahead: it must not take the old process for the new one.
        {"kind": "crash", "agents": [2], "from": 2.1, "until": 2.3},
        {"kind": "pause", "agents": [3], "from": 2.5, "until": 3.0},
        {"kind": "loss", "probability": 0.2},
        {"kind": "crash", "agents": [0], "from": 3.5},
    ]
    run(world, EVERY_KIND | {"steps": 40, "fault": fault, "filter": {"lag_seconds": 0.5}})
    computed = said(again(world, world.log))
    del computed["event/agent/0"]  # a killed process has no last words
    assert computed == said(world.log)
    reported: list[Any] = list(read_trace(world.log).events)
    events = [(event["kind"], event["data"]) for event in reported if event["kind"] != "finished"]
    told = [
        (kind, data.get("agent"), data.get("step"))
        for kind, data in events
        if kind not in {"rejected", "fault", "here"}
    ]
    assert told[1:] == [
        ("killed", 1, 10),
        ("joined", 1, 20),
        ("killed", 2, 21),
        ("joined", 2, 23),
        ("paused", 3, 25),
        ("continued", 3, 25),
        ("killed", 0, 35),
    ]


def test_an_agent_that_comes_back_with_its_only_neighbour_has_the_simulators_guess(world):
    fault = [{"kind": "crash", "agents": [0, 1], "from": 0.5, "until": 1.0}]
    line = {"agents": {"count": 4}, "network": {"edges": [[0, 1], [1, 2], [2, 3]]}, "consensus": {"rounds": 3}}
    run(world, {"steps": 14, **line, "fault": fault})
    assert said(again(world, world.log)) == said(world.log)


def test_a_network_that_shrinks_below_what_it_can_see_says_so(world):
    fault = [{"kind": "crash", "agents": [2], "from": 1.5}, {"kind": "pause", "agents": [1], "from": 0.4, "until": 0.6}]
    network = {"agents": {"count": 3}, "network": {"graph": "complete"}, "consensus": {"rounds": 2}}
    metrics = run(world, {"steps": 40, **network, "fault": fault})
    assert metrics.unobservable_steps == [[15, 40]]
    reported: list[Any] = list(read_trace(world.log).events)
    events = [event for event in reported if "observable" in event["kind"]]
    told = [(event["from"], event["kind"], event["data"]["step"], event["data"].get("agents")) for event in events]
    assert told == [
        ("target", "unobservable", 4, [0, 2]),
        ("target", "observable", 6, None),
        ("target", "unobservable", 15, [0, 1]),
    ]
    assert events[2]["text"].endswith("ranges of 2 agents fit every point of a circle")


def test_in_realtime_a_delay_is_real_time_and_only_what_exceeds_the_deadline_is_late(world):
    scenario = {
        "steps": 15,
        "dt": 0.4,
        "agents": {"count": 4},
        "network": {"graph": "ring"},
        "consensus": {"rounds": 3},
        "timing": {"mode": "realtime"},
        "fault": [
            {"kind": "delay", "milliseconds": 5.0, "links": [[0, 1]]},
            {"kind": "delay", "milliseconds": 1000.0, "links": [[1, 0]]},
            {"kind": "corrupt", "probability": 1.0, "links": [[2, 3]]},
            {"kind": "clock", "offset": -1000.0, "agents": [2], "from": 2.0},
        ],
    }
    path = world.folder / "scenario.toml"
    path.write_text(tomli_w.dumps(scenario))
    world.done("run", str(path), "--run", world.run, "--log", str(world.log), "--no-report")
    [analysis] = analyze([read_trace(world.log)])
    links = {(one.source, one.destination): one for one in analysis.metrics.links}
    assert links[0, 1].delivered > 0
    assert links[0, 1].latency is not None
    assert links[1, 0].delivered == 0
    assert links[1, 0].injected_late > 0
    assert links[2, 3].corrupted == links[2, 3].sent == 45
    for link in links.values():
        assert link.lost == link.injected_lost + link.corrupted + link.real_lost
        assert link.late == link.injected_late + link.deadline_missed
        assert link.sent == link.delivered + link.lost + link.late == 45
        assert link.real_lost >= 0
    # The clock of agent 2 is a quarter of an hour behind from step 5 on, which is 11 of 15 steps.
    assert (links[2, 1].latency or 0.0) > 600.0
    assert (links[1, 2].latency or 0.0) < -600.0
    assert all(link.injected_late == 0 for at, link in links.items() if at not in {(0, 1), (1, 0)})
