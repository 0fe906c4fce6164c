"""What a run is said to ask of its processes, counted in a log and by hand."""

from collections import Counter, defaultdict
from pathlib import Path

import pytest

from zenoh_cbef.analysis.demand import demand
from zenoh_cbef.analysis.traffic import beacon_bytes, range_bytes, truth_bytes
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.protocol.keys import address
from zenoh_cbef.scenario.load import load

GOLDEN = Path(__file__).resolve().parents[1] / "golden"
OF_STEPS = {"truth", "beacon", "range", "round", "estimate"}


@pytest.mark.parametrize("name", ["sicf", "cbef", "local"])
def test_the_recorder_hears_what_a_log_has(name):
    plan, messages, sizes = read_trace(GOLDEN / f"{name}.mcap").plan, Counter[str](), defaultdict(set)
    for message in open_log(GOLDEN / f"{name}.mcap").messages():
        where = address(message.channel.topic)
        # In older logs signals are among the beacons.
        if where is not None and where.kind in OF_STEPS and b"signal" not in message.data:
            messages[where.kind] += 1
            # The formulas take the scenario's name for the run's.
            sizes[where.kind].add(len(message.data) - len(where.run) + len(plan.scenario.name))
    assert demand(plan).recorder.received * plan.scenario.length == messages.total()
    known = {"beacon": beacon_bytes(plan), "truth": truth_bytes(plan), "range": range_bytes(plan)}
    assert {kind: sizes[kind] for kind in known} == {kind: {size} for kind, size in known.items()}


@pytest.mark.parametrize("kind", ["sicf", "cbef"])
def test_what_is_sent_is_received_by_graph_and_through_a_router(kind):
    plan = load("tracking", [f"filter.kind={kind}", "agents.count=9", "network.graph=grid", "consensus.rounds=3"]).plan
    told, routed = demand(plan), demand(plan, routed=True)
    assert routed.router is not None
    for part in ("sent", "bytes_sent"):
        heard = part.replace("sent", "received")
        sent = 9 * getattr(told.agent, part) + getattr(told.target, part)
        received = 9 * getattr(told.agent, heard) + getattr(told.target, heard) + getattr(told.recorder, heard)
        assert sent == pytest.approx(received)
        assert getattr(routed.router, part) == pytest.approx(received)
        into = 9 * getattr(routed.agent, part) + getattr(routed.target, part)
        assert getattr(routed.router, heard) == pytest.approx(into)
    # A grid of nine: the one in the middle has four neighbours, 3 rounds to each and to the recorder; its estimate goes
    # to the target and the recorder, its range to the recorder and, where the filter uses it, to its neighbours.
    assert told.busiest.links == 6
    assert told.busiest.sent == 5 * 3 + 2 + (5 if kind == "cbef" else 1)
    assert (told.target.links, told.recorder.links, routed.router.links) == (10, 10, 11)


def test_nothing_that_an_agent_carries_grows_with_the_number_of_agents():
    few, many = (
        demand(load("tracking", [f"agents.count={agents}", "network.graph=ring"]).plan) for agents in (10, 1000)
    )
    assert (few.agent.links, few.agent.sent, few.agent.received) == (4, 33, 21)
    assert (many.agent.links, many.agent.sent, many.agent.received) == (4, 33, 21)
    assert many.recorder.received == pytest.approx(100 * few.recorder.received, rel=0.01)
