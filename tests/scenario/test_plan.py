"""What follows from a scenario is found once and handed down."""

from __future__ import annotations

import sys
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import numpy as np
import pytest

from tests.log.made import made_log
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.exchange import read_exchange
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.recording import read_recording
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.log.tools.check import check
from zenoh_cbef.nodes.agent.agent import Agent
from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.scenario.build import agent_tracker
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.filters import KINDS, make_filter
from zenoh_cbef.tracking.ranging import Measurement

LOSS = 'fault=[{kind="loss", probability=0.2}]'


@contextmanager
def calls_of(function: Callable[..., Any]) -> Iterator[list[str]]:
    """Who calls a function in this thread, by the names of the calling functions."""
    callers = []

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code is function.__code__ and frame.f_back:
            callers.append(frame.f_back.f_code.co_name)

    sys.setprofile(note)
    try:
        yield callers
    finally:
        sys.setprofile(None)


def test_one_agents_start_makes_one_filter_and_injected_faults_make_none():
    run = f"plan-{uuid.uuid4().hex[:12]}"
    plan = load("tracking", ["agents.count=4", "timing.mode=realtime", "filter.recovery=true"]).plan
    with Node(Identity(run, "agent", "1")) as node, calls_of(make_filter) as made:
        agent = Agent(node, plan, 1)
        assert len(made) == 1
        agent.inject('[{"kind": "loss", "probability": 0.5}]')
    assert len(made) == 1
    assert not agent.neighbourhood.fates.quiet


def test_reading_a_log_makes_no_filter_and_proving_it_makes_one(tmp_path):
    log = made_log(tmp_path / "run.mcap", "steps=6", "agents.count=4", LOSS)
    with calls_of(make_filter) as made:
        assert len(read_trace(log).estimates) == 4
        assert read_recording(open_log(log), rounds="payloads").rounds.last == 6
        assert read_exchange(log).passages
        assert check(open_log(log)).exit_status == 0
    assert not made
    with calls_of(make_filter) as made:
        assert verify(log).result == "equal"
    assert len(made) == 1


def test_an_analysis_finds_the_plan_with_the_trace(tmp_path):
    trace = read_trace(made_log(tmp_path / "run.mcap", "steps=6", "agents.count=4"))
    with calls_of(Plan.__init__) as made:
        assert analyze([trace])[0].metrics.agents == 4
    assert not made


AROUND = [
    ["filter.recovery=true"],
    ["filter.distrust=true"],
    ["filter.bias=estimate"],
    ["filter.bias=auto", "sensor.bias_std=0.5", "filter.distrust=true", "filter.range_std=auto"],
    ["filter.planar_height=1.0"],
    ["filter.kind=ci", "filter.measurement=difference"],
    [LOSS],
]


@pytest.mark.parametrize("keys", [*([f"filter.kind={kind}"] for kind in sorted(KINDS)), *AROUND], ids=" ".join)
def test_what_is_exchanged_is_known_without_a_filter_and_true(keys):
    plan = load("tracking", ["agents.count=4", *keys]).plan
    shared, width = plan.sharing, plan.message_size
    assert "filter" not in vars(plan)
    tracker, others = agent_tracker(plan, 0)
    heard = len(others) if shared.uses_neighbour_ranges else 0
    here = Measurement(np.zeros((1, 3)), np.ones(1), np.zeros(1), np.ones((1, heard, 3)), np.ones((1, heard)))
    assert tracker.measure(here).shape == (1, width)
    assert shared.cooperates is (keys != ["filter.kind=local"])


@pytest.mark.parametrize("name", ["tracking", "outliers", "paper", "lawnmower"])
def test_a_plan_under_another_seed_takes_over_what_it_would_have_found_itself(name):
    first = load(name).plan
    other = first.scenario.changed(seed=first.scenario.seed + 7)
    alone, like = Plan(other), Plan(other, first)
    assert repr(like.settings) == repr(alone.settings)
    assert (like.scheme, like.rounds, like.smoothing_lag) == (alone.scheme, alone.rounds, alone.smoothing_lag)
    assert like.filter is first.filter
    np.testing.assert_array_equal(like.initial_states, alone.initial_states)
    np.testing.assert_array_equal(like.edges, alone.edges)


def test_the_deadlines_of_a_step_end_with_it_and_leave_time_for_the_filter_first():
    plan = load("tracking", ["timing.mode=realtime", "dt=0.26", "consensus.rounds=10"]).plan
    assert [plan.deadline(round_) for round_ in (0, 1, 10)] == pytest.approx([0.06, 0.08, 0.26])


def test_rounds_of_a_given_length_follow_one_another_from_the_beginning_of_the_step():
    plan = load("tracking", ["timing.mode=realtime", "timing.round_deadline_ms=5", "consensus.rounds=10"]).plan
    assert [plan.deadline(round_) for round_ in (0, 1, 10)] == pytest.approx([0.005, 0.01, 0.055])
