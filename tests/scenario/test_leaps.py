"""In steps that are long for a target which turns, agents assume that it may be anywhere after one."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario import start
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate

CIRCLE = ("target.motion=circle", "target.radius=5", "target.period=8", "dt=1")
MANY = (*CIRCLE, "agents.count=16")
EIGHT = ("target.motion=lemniscate", "target.radius=9", "target.period=40", "dt=3")
FAST = ("target.motion=lemniscate", "target.radius=3", "target.period=2", "dt=0.3")
BIASED = (*CIRCLE, "sensor.bias_std=0.3")
REST = ("filter.motion=stationary",)


def plan_of(*sets, rules=15):
    return Plan(load("tracking", [*sets, f"filter.defaults={rules}"]).scenario)


def rmse(*sets):
    """Of all agents, in twenty steps after the first twenty, m."""
    scenario = load("tracking", [*sets, "steps=40", "seed=1001"]).scenario
    with np.errstate(all="ignore"):
        (trace,) = simulate([scenario])
    off = np.linalg.norm((trace.estimates - trace.truth)[:, 20:, :3], axis=2)
    return float(np.sqrt(np.mean(off**2)))


def test_many_agents_have_one_motion_of_several_noises_on_squared_ranges():
    before, plan = plan_of(*MANY, rules=14), plan_of(*MANY)
    assert len(before.models) == 4
    assert not before.squares
    assert not plan.models
    assert plan.squares
    assert not plan.tells_ranges
    assert plan.noises[-1].acceleration_std == plan.motion.acceleration_std == start.half_box(plan.scenario)


def test_biases_leave_room_for_one_motion():
    before, plan = plan_of(*BIASED, rules=14), plan_of(*BIASED)
    assert plan.tells_ranges
    assert plan.settings.joint_biases
    assert not plan.models
    assert plan.motion.acceleration_std > 100.0 * before.motion.acceleration_std


@pytest.mark.parametrize(
    "sets",
    [
        ("target.motion=circle", "target.radius=5", "target.period=8"),
        (*CIRCLE, "agents.count=3"),
        (*CIRCLE, "filter.linearise=before", "agents.count=16"),
        (*CIRCLE, "filter.motion=imm", "agents.count=16"),
        (*MANY, "agents.low=[-10,-10,0]", "agents.high=[10,10,0]"),
        (*MANY, "sensor.outlier_probability=0.1"),
        (*MANY, "sensor.bias_std=0.1"),
        (*CIRCLE, 'fault=[{kind="byzantine",mode="constant",magnitude=5.0,agents=[3]}]'),
        ("dt=1",),
    ],
)
def test_elsewhere_all_is_as_before(sets):
    before, plan = plan_of(*sets, rules=14), plan_of(*sets)
    assert (plan.models, plan.motion, plan.noises) == (before.models, before.motion, before.noises)
    assert (plan.tells_ranges, plan.squares) == (before.tells_ranges, before.squares)


@pytest.mark.slow
@pytest.mark.parametrize("sets", [MANY])
def test_the_network_holds_its_target(sets):
    assert rmse(*sets, "filter.defaults=14") > 1.0
    assert rmse(*sets) < 0.5


def test_the_noise_of_a_motion_at_rest_is_not_that_of_a_moving_target():
    before, plan = plan_of(*REST, rules=14), plan_of(*REST)
    assert before.motion.acceleration_std == plan.scenario.target.acceleration_std
    assert not before.noises
    assert plan.motion.acceleration_std == pytest.approx(5.0)
    assert len(plan.noises) == 5
    assert plan_of(*REST, "filter.acceleration_std=2").motion.acceleration_std == 2.0
    assert rmse(*REST) < 0.5 * rmse(*REST, "filter.defaults=14")


def test_a_motion_at_rest_allows_for_as_far_as_the_target_gets_in_a_step():
    fast = *REST, "target.motion=waypoints", "target.speed=30", "target.waypoints=[[-90,0,0],[0,90,10],[90,0,0]]"
    plan = plan_of(*fast, rules=16)
    assert plan.motion.acceleration_std == 2.0 * start.reach(plan.scenario) / plan.scenario.dt**2
    assert plan_of(*fast, rules=15).noises[-1].acceleration_std < plan.motion.acceleration_std


def test_few_agents_tell_each_other_their_ranges_of_a_target_that_may_be_anywhere_a_step_later():
    before, plan = plan_of(*FAST, rules=20), plan_of(*FAST, rules=21)
    assert before.squares
    assert not before.tells_ranges
    assert plan.tells_ranges
    # Its velocity may become any other one that is as fast: by twice as much as it is in a step, one deviation by half.
    assert plan.models[-1].acceleration_std == start.reach(plan.scenario) / plan.scenario.dt**2
    assert plan_of(*MANY, rules=21).squares


@pytest.mark.slow
def test_wrong_ranges_do_not_lose_it():
    wrong = *FAST, "sensor.outlier_probability=0.3", "sensor.outlier_scale=20"
    assert rmse(*wrong, "filter.defaults=20") > 10.0
    assert rmse(*wrong) < 3.0


def test_a_target_that_is_told_to_be_slow_gets_no_farther_than_six_deviations():
    slow = "target.motion=circle", "target.period=320", "dt=1.6", "filter.initial_velocity_std=0.05"
    before, plan = plan_of(*slow, rules=20), plan_of(*slow, rules=21)
    assert before.squares
    assert plan.tells_ranges
    assert start.reach(before.scenario) == pytest.approx(3.0 * 1.6)
    assert start.reach(plan.scenario) == pytest.approx(6.0 * 0.05 * 1.6)
    known = plan_of(*slow, "filter.initial_velocity=[0.5,0,0]", rules=21)
    assert start.reach(known.scenario) == pytest.approx(0.5 * 1.6)
