"""A run is what its scenario says: every message is accounted for, and a trace holds all that happened."""

from __future__ import annotations

import numpy as np
import pytest

from tests.simulator.made import FAULTS, LOSS, assert_same, scenario
from zenoh_cbef.scenario.build import fates_into
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import heard_in, simulate


@pytest.mark.parametrize("kind", ["sicf", "cbef", "local"])
@pytest.mark.parametrize("fault", FAULTS)
def test_every_message_is_delivered_lost_or_late(kind, fault):
    one = scenario(4, filter={"kind": kind}, fault=FAULTS[fault], steps=20)
    [trace] = simulate([one])
    links, per_step = trace.links, {"sicf": 3, "cbef": 4, "local": 0}[kind]
    edges = {tuple(edge) for edge in trace.edges.tolist()}
    pairs = list(zip(links.source.tolist(), links.destination.tolist(), strict=True))
    assert sorted(pairs) == sorted([*edges, *[(second, first) for first, second in edges]])
    assert links.sent.tolist() == [20 * per_step] * len(pairs)
    first_round, plan = 0 if kind == "cbef" else 1, Plan(one)
    for place, (source, destination) in enumerate(pairs):
        fates = fates_into(plan, destination, [source])
        rounds = [(step, round_) for step in range(1, 21) for round_ in range(first_round, plan.rounds + 1)]
        told = [fates.of(*at) for at in rounds]
        due, late = sum(int(one.due[0]) for one in told), sum(int(one.late[0]) for one in told)
        assert links.delivered[place] == due
        assert links.late[place] == late
        assert links.lost[place] == len(rounds) - due - late
    assert np.isnan(links.latency).all()


def test_the_share_of_lost_messages_is_the_configured_one():
    [trace] = simulate([scenario(5, fault=[LOSS], steps=200, network={"graph": "complete"})])
    sent = trace.links.sent.sum()
    assert sent == 200 * 3 * 20
    assert abs(trace.links.lost.sum() / sent - 0.3) < 6 * np.sqrt(0.21 / sent)
    assert trace.links.late.sum() == 0


def test_messages_that_all_come_late_do_as_much_as_messages_that_are_all_lost():
    unasked = {"membership": False}  # Of loss of all messages agents know that it cuts them off.
    lost, late = (
        simulate([scenario(6, fault=[fault], filter=unasked)])[0]
        for fault in ({"kind": "loss", "probability": 1.0}, {"kind": "delay", "milliseconds": 0.5})
    )
    assert lost.estimates.tobytes() == late.estimates.tobytes()
    assert late.links.late.tolist() == late.links.sent.tolist() == lost.links.lost.tolist()


@pytest.mark.parametrize("milliseconds", [1.0, 24.9, 25.1, 1000.0])
def test_a_delay_below_or_above_a_slot_misses_its_round_and_no_delay_does_not(milliseconds):
    # dt is 0.1 s and there are three rounds, so a slot takes 25 ms; arriving in a later slot is late.
    [delayed] = simulate([scenario(6, fault=[{"kind": "delay", "milliseconds": milliseconds}])])
    assert delayed.links.late.tolist() == delayed.links.sent.tolist()
    # A configured fault alone would choose another scheme.
    average = {"consensus": {"scheme": "average"}}
    [punctual] = simulate([scenario(6, fault=[{"kind": "delay", "milliseconds": 0.0}], **average)])
    [clean] = simulate([scenario(6)])
    assert_same(punctual, clean)


def test_agents_that_hear_no_neighbour_still_track():
    [trace] = simulate([scenario(7, fault=[{"kind": "loss", "probability": 1.0}])])
    assert np.isfinite(trace.estimates).all()
    assert trace.links.delivered.sum() == 0


@pytest.mark.parametrize("scheme", ["average", "running-sums"])
def test_a_fault_that_has_not_begun_changes_nothing_until_it_does(scheme):
    stage = {"consensus": {"scheme": scheme}}
    [clean] = simulate([scenario(8, steps=10, **stage)])
    [faulty] = simulate([scenario(8, steps=10, fault=[{**LOSS, "probability": 1.0, "from": 0.55}], **stage)])
    assert clean.estimates[:, :5].tobytes() == faulty.estimates[:, :5].tobytes()
    assert (clean.estimates[:, 5] != faulty.estimates[:, 5]).any()


def test_a_longer_run_begins_like_a_shorter_one():
    [short], [long] = (simulate([scenario(9, fault=[LOSS], steps=steps)]) for steps in (4, 9))
    assert long.estimates[:, :4].tobytes() == short.estimates.tobytes()


def test_recorded_measurements_replace_the_emulated_ones():
    one, other = scenario(10), scenario(11)
    heard = heard_in(Plan(other), make_world(other))
    [trace] = simulate([one], heard=[heard])
    assert trace.ranges.tobytes() == heard.ranges.tobytes()
    [emulated] = simulate([one])
    assert (trace.estimates != emulated.estimates).any()
    [again] = simulate([one], heard=[heard_in(Plan(one), make_world(one))])
    assert_same(again, emulated)


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("kind", ["sicf", "cbef"])
def test_the_smallest_networks_run(count, kind):
    [trace] = simulate([scenario(12, agents={"count": count}, filter={"kind": kind})])
    assert trace.estimates.shape == (count, 5, 6)
    assert np.isfinite(trace.estimates).all()
    assert len(trace.links.sent) == 2 * (count - 1)


def test_a_trace_holds_the_run():
    steps: list[int] = []
    one = scenario(13, consensus={"rounds": 4})
    [trace] = simulate([one], keep_payloads=True, progress=steps.append)
    assert steps == [1, 2, 3, 4, 5]
    assert trace.payloads is not None
    assert trace.payloads.shape == (5, 5, 4, Plan(one).message_size)
    assert trace.covariances.shape == (5, 5, 6, 6)
    np.testing.assert_array_equal(np.isnan(trace.diagnostics.innovation), np.isnan(trace.ranges))
    np.testing.assert_array_equal(np.isnan(trace.diagnostics.weight), np.isnan(trace.ranges))
    assert trace.scenario == one
    assert simulate([one])[0].payloads is None


def test_no_rounds_leave_agents_with_what_they_know_themselves():
    [trace] = simulate([scenario(14, consensus={"rounds": 0}, network={"graph": "complete"})])
    assert np.isfinite(trace.estimates).all()
    assert trace.links.sent.tolist() == [0] * 20
