"""The simulator is the same tracker as the processes', in any batch and for agents on their own."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.simulator.made import FAULTS, FILTERS, LOSS, assert_same, scenario
from zenoh_cbef import simulator
from zenoh_cbef.scenario import network
from zenoh_cbef.scenario.build import agent_tracker, fates_into, outgoing_of
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import heard_in, simulate
from zenoh_cbef.tracking.filters.around.bursts import Bursts
from zenoh_cbef.tracking.motion import MOTIONS
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours

STAGES = {
    f"{weights} {acceleration}": {"weights": weights, "acceleration": acceleration, "scheme": "average"}
    for weights, acceleration in itertools.product(["uniform", "metropolis"], ["none", "chebyshev"])
} | {
    "running sums": {"scheme": "running-sums"},
    "trimmed": {"trim": 1},
    "triggered": {"trigger": 0.2, "precision": "int12"},
}


def met(stages):
    """Every filter in every stage, each under one of the four faults: all filters meet all faults, as all stages do."""
    pairs = itertools.product(enumerate(FILTERS), enumerate(stages))
    return [(kind, stage, list(FAULTS)[(row + column) % 4]) for ((row, kind), (column, stage)) in pairs]


@pytest.mark.parametrize(("kind", "stage", "fault"), met(STAGES))
def test_a_run_is_the_same_alone_in_a_batch_and_in_parts(kind, stage, fault, monkeypatch):
    planar = fault in {"loss", "delay"}
    keys = {
        "filter": {**FILTERS[kind], **({"planar_height": 0.4} if planar else {})},
        "consensus": STAGES[stage],
        "fault": FAULTS[fault],
    }
    runs = [scenario(seed, **keys) for seed in (1, 2**64 - 1)]
    together = simulate(runs, keep_payloads=True)
    [alone] = simulate(runs[:1], keep_payloads=True)
    monkeypatch.setattr(simulator, "_BLOCK", 2)
    [parts] = simulate(runs[1:], keep_payloads=True)
    for one, expected in zip((alone, parts), together, strict=True):
        assert_same(one, expected)
        assert (one.payloads is None) == (expected.payloads is None)
        if one.payloads is not None and expected.payloads is not None:
            assert one.payloads.tobytes() == expected.payloads.tobytes()


@pytest.mark.parametrize(
    "more",
    [
        {"lag_seconds": 1.0},
        {"motion": "imm"},
        {"bias": "estimate"},
        {"planar_height": 0.4},
        {"acceleration_std": 0.3, "lag_seconds": 1.0},
    ],
)
def test_a_run_that_smooths_and_forgets_is_the_same_in_parts(more, monkeypatch):
    crash = {"kind": "crash", "agents": [1], "from": 2.3, "until": 2.6}
    heard = {"reach": 6.0}
    assert_same_in_parts(scenario(filter={"kind": "sicf", **more}, fault=[crash], sensor=heard, steps=40), monkeypatch)


def assert_same_in_parts(one, monkeypatch):
    [expected] = simulate([one], keep_payloads=True)
    monkeypatch.setattr(simulator, "_BLOCK", 2)
    [parts] = simulate([one], keep_payloads=True)
    assert_same(parts, expected)
    assert (parts.payloads is None) == (expected.payloads is None)
    if parts.payloads is not None and expected.payloads is not None:
        assert parts.payloads.tobytes() == expected.payloads.tobytes()
    assert (parts.smoothed is None) == (expected.smoothed is None)
    if parts.smoothed is not None and expected.smoothed is not None:
        assert parts.smoothed.states.tobytes() == expected.smoothed.states.tobytes()


@pytest.mark.parametrize("planar", [False, True])
def test_biases_beside_several_motions_are_the_same_for_agents_on_their_own_and_in_parts(planar, monkeypatch):
    keys = {
        "target": {"motion": "circle", "position": [0.4, 0.4, 0.4], "radius": 0.4, "period": 5.0},
        "sensor": {"bias_std": 0.1},
        "consensus": {"rounds": 4},
        "filter": {"kind": "sicf", "lag_seconds": 0.3, **({"planar_height": 0.4} if planar else {})},
    }
    one = scenario(3, steps=8, fault=[LOSS], **keys)
    plan = Plan(one)
    assert (bool(plan.models), plan.bias, plan.tells_ranges) == (True, "estimate", True)
    assert_agents_on_their_own_compute(one)
    away = {"kind": "crash", "agents": [1], "from": 1.3, "until": 1.6}
    assert_same_in_parts(scenario(3, steps=20, fault=[away], **keys), monkeypatch)


class Agent:
    """What an agent process does, without the process: its own tracker, fates and neighbours."""

    def __init__(self, plan, number):
        self.plan = plan
        self.tracker, self.others = agent_tracker(self.plan, number)
        self.fates = fates_into(self.plan, number, self.others)
        self.outgoing = outgoing_of([self.plan], [number])
        self.number = number

    def told_range(self, heard, step):
        return self.outgoing.ranges(step, heard.ranges[[self.number], step - 1])[0]

    def measure(self, heard, step, told):
        own = self.number, step - 1
        positions, ranges = no_neighbours(1)
        if self.plan.sharing.uses_neighbour_ranges:
            due = self.fates.of(step, 0).due
            positions = np.where(due[:, None], heard.positions[self.others, step - 1], 0.0)[None]
            ranges = np.where(due, told[self.others], np.nan)[None]
        mine = heard.positions[own][None], heard.ranges[own][None], heard.age[own][None]
        number = np.array([self.number])
        return self.tracker.measure(Measurement(*mine, positions, ranges, step=step, agent=number))

    def exchange(self, sent, step, round_):
        due = self.fates.of(step, round_).due
        received = np.zeros((1, len(self.others), sent[self.number].shape[1]))
        for place, other in enumerate(self.others):
            if due[place]:
                received[0, place] = sent[other][0]
        return self.tracker.exchange(received, due[None] if not due.all() else None)


def assert_agents_on_their_own_compute(one):
    [trace] = simulate([one], keep_payloads=True)
    plan = Plan(one)
    agents = [Agent(plan, number) for number in range(5)]
    heard = heard_in(plan, make_world(one))
    for step in range(1, one.steps + 1):
        told = np.array([agent.told_range(heard, step) for agent in agents])
        sent = [agent.measure(heard, step, told) for agent in agents]
        for round_ in range(1, plan.rounds + 1):
            sent = [agent.outgoing.message(step, round_, own) for agent, own in zip(agents, sent, strict=True)]
            assert sent[0].shape == (1, plan.message_size)
            assert trace.payloads is not None
            assert np.concatenate(sent).tobytes() == trace.payloads[:, step - 1, round_ - 1].tobytes()
            sent = [agent.exchange(sent, step, round_) for agent in agents]
        for agent in agents:
            estimate = agent.tracker.conclude()
            assert estimate.state[0].tobytes() == trace.estimates[agent.number, step - 1].tobytes()
            for name, values in estimate.diagnostics.named().items():
                assert values[0].tobytes() == getattr(trace.diagnostics, name)[agent.number, step - 1].tobytes(), name
            if estimate.covariance is not None:
                assert estimate.covariance[0].tobytes() == trace.covariances[agent.number, step - 1].tobytes()


@pytest.mark.parametrize(
    ("kind", "stage", "fault"), met(["metropolis none", "metropolis chebyshev", "running sums", "trimmed"])
)
def test_agents_on_their_own_compute_the_bits_of_the_simulator(kind, stage, fault):
    assert_agents_on_their_own_compute(
        scenario(3, filter=FILTERS[kind], consensus=STAGES[stage], fault=FAULTS[fault], steps=6)
    )


# Each filter and each motion is met in the plane and in space.
@pytest.mark.parametrize(
    ("kind", "motion", "planar"),
    [
        (kind, motion, (row + column) % 2 == 0)
        for row, kind in enumerate(["sicf", "hcmci", "kcf", "local"])
        for column, motion in enumerate(sorted(set(MOTIONS) - {"ncv"}))
    ]
    + [("sicf", "imm", True), ("icf", "imm", False)],
)
def test_every_motion_is_the_same_for_agents_on_their_own_and_in_a_batch(motion, kind, planar):
    filter_ = {"kind": kind, "motion": motion, **({"planar_height": 0.4} if planar else {})}
    assert_agents_on_their_own_compute(scenario(3, filter=filter_, fault=FAULTS["liar"], steps=6))
    away = {"kind": "crash", "agents": [1], "from": 0.35, "until": 0.65}
    runs = [scenario(seed, filter=filter_, fault=[away], steps=8) for seed in (1, 2)]
    for one, expected in zip(runs, simulate(runs), strict=True):
        assert_same(simulate([one])[0], expected)


def test_noises_in_doubt_are_weighed_the_same_for_agents_on_their_own():
    doubting = scenario(3, filter={"kind": "sicf", "acceleration_std": 0.3}, fault=[LOSS], steps=8)
    assert Plan(doubting).noises
    assert_agents_on_their_own_compute(doubting)


def test_what_agents_learn_of_bursts_is_the_same_for_agents_on_their_own_and_in_parts(monkeypatch):
    burst = {"kind": "sensor-spikes", "probability": 0.8, "agents": [1], "from": 2.5, "until": 4.0}
    keys = {
        "agents": {"low": -10.0, "high": 10.0},
        "target": {"motion": "circle", "position": [0.0, 0.0, 0.0], "radius": 5.0, "period": 8.0},
        "fault": [burst, LOSS],
        "steps": 40,
    }
    (learns, trusts) = (scenario(3, filter={"kind": "sicf", "defaults": rules}, **keys) for rules in (19, 18))
    assert Bursts.wanted(Plan(learns).settings)
    first, second = (simulate([one])[0].diagnostics.weight[1] for one in (learns, trusts))
    assert not np.array_equal(first, second, equal_nan=True)
    assert_agents_on_their_own_compute(learns)
    assert_same_in_parts(learns, monkeypatch)


@pytest.mark.parametrize("filter_", [{"kind": "sicf"}, {"kind": "icf", "motion": "imm"}])
def test_what_averages_of_few_agents_count_for_is_the_same_for_agents_on_their_own_and_in_parts(filter_, monkeypatch):
    monkeypatch.setattr(network, "FEW", 0)
    few = scenario(3, filter=filter_, consensus={"rounds": 1, "weights": "uniform", "epsilon": 0.05}, steps=30)
    assert (Plan(few).overcounted > 1.0).all()
    assert_agents_on_their_own_compute(few)
    assert_same_in_parts(few, monkeypatch)


SAYING: dict[str, dict] = {
    "bias": {"filter": {"kind": "sicf", "bias": "estimate"}},
    "bias_weight": {"filter": {"kind": "sicf", "bias": "auto"}, "sensor": {"bias": 0.3}},
    "distrust": {"filter": {"kind": "sicf", "distrust": True}},
    "maneuver": {"filter": {"kind": "icf", "motion": "imm", "distrust": True, "range_std": "auto"}},
    "status": {"filter": {"kind": "hcmci"}},
    "silent": {"consensus": {"trigger": 0.3}},
    "status_seconds": {"filter": {"kind": "sicf", "bias": "auto", "range_std": "auto", "recovery": True}},
}


@pytest.mark.parametrize("name", SAYING)
def test_what_only_some_filters_say_is_the_same_alone_and_in_a_batch_and_absent_agents_say_nothing(name):
    away = {"kind": "crash", "agents": [1], "from": 0.35, "until": 0.65}
    assert_agents_on_their_own_compute(scenario(3, steps=6, **SAYING[name]))
    # In a first fix there is little to say.
    given = SAYING[name] | {"filter": SAYING[name].get("filter", {}) | {"start": "given"}}
    runs = [scenario(seed, steps=10, fault=[away], **given) for seed in (1, 2)]
    for one, expected in zip(runs, simulate(runs), strict=True):
        [alone] = simulate([one])
        assert_same(alone, expected)
        said = expected.diagnostics.named()
        # The crash begins before step 4, at 0.4 s, and is over before step 7.
        there = np.ones((5, 10), dtype=bool)
        there[1, 3:6] = False
        assert np.isfinite(said[name][there]).all()
        for found in (expected.estimates, expected.covariances):
            assert np.isfinite(found[there]).all()
            assert np.isnan(found[~there]).all()
        np.testing.assert_array_equal(said["nis_degrees"], there & np.isfinite(expected.ranges))
        for what, values in said.items():
            assert (values[~there] == 0).all() if what == "nis_degrees" else np.isnan(values[~there]).all(), what


def test_more_runs_than_a_batch_holds_are_the_same_runs():
    scenarios = [scenario(seed, fault=[LOSS]) for seed in range(1, 151)]
    told: list[int] = []
    together = simulate(scenarios, progress=told.append)
    for place in (0, 71, 72, 149):
        assert_same(simulate([scenarios[place]])[0], together[place])
        assert (together[place].edges == network.edges(scenarios[place])).all()
    assert told == sorted(told)
    assert told[-1] == 5
