"""Networks with a receiver that is wrong suppose of each in turn that it is, and find the target without it."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import Heard, heard_in, simulate
from zenoh_cbef.tracking.status import LOST, TRACKING

BIASED = ("agents.count=5", "steps=100", 'fault=[{kind="sensor-bias",bias=3.0,agents=[1]}]')


def runs(*overrides, seeds=12, first=7001):
    return [load("tracking", [*overrides, f"seed={first + more}"]).scenario for more in range(seeds)]


def off(trace):
    """The position errors of a run, (n, K), m."""
    return np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2)


def sure(trace):
    """The share of the last 50 steps in which agents say `tracking` and are off by a metre."""
    return ((off(trace) > 1.0) & (trace.diagnostics.status == TRACKING))[:, -50:].mean()


@pytest.fixture(scope="module")
def biased():
    """Runs with one wrong receiver of five, by the rules before and by today's."""
    return {rules: simulate(runs(*BIASED, f"filter.defaults={rules}")) for rules in (4, 5)}


@pytest.mark.slow
def test_one_wrong_receiver_of_five_loses_fewer_networks(biased):
    lost = {rules: sum(off(trace)[:, -1].max() > 1.0 for trace in traces) for rules, traces in biased.items()}
    assert lost[4] >= 3
    assert lost[5] <= lost[4] // 2


def test_a_network_that_is_off_does_not_say_tracking(biased):
    before, today = (np.mean([sure(trace) for trace in biased[rules]]) for rules in (4, 5))
    assert before > 0.02
    assert today <= 0.01


def test_the_wrong_receiver_is_left_out_and_no_other(biased):
    left = np.array([(trace.diagnostics.distrust[:, -1] == 1.0) for trace in biased[5]])
    assert left[:, 1].mean() > 0.5
    assert not left[:, [0, 2, 3, 4]].any()


def test_where_all_is_well_no_agent_asks():
    before, today = (simulate(runs(f"filter.defaults={rules}", "steps=120", seeds=6)) for rules in (4, 5))
    for old, new in zip(before, today, strict=True):
        assert old.estimates.tobytes() == new.estimates.tobytes()


@pytest.mark.slow
def test_a_receiver_that_is_right_again_takes_part_again():
    fault = 'fault=[{kind="sensor-bias",bias=3.0,agents=[1],until=6.0}]'
    for trace in simulate(runs("agents.count=5", "steps=200", fault, seeds=6)):
        assert not (trace.diagnostics.distrust[:, -1] == 1.0).any()


def test_ranges_that_nothing_explains_are_said_to_be_lost():
    [one] = runs(seeds=1)
    heard = heard_in(Plan(one), make_world(one))
    wrong = heard.ranges + np.array([2.0, -3.0, 4.0, 0.0, -2.0, 3.0])[:, None]
    [trace] = simulate([one], heard=[Heard(heard.positions, wrong, heard.age)])
    assert (trace.diagnostics.status[:, 60:] == LOST).mean() > 0.5


def test_a_network_whose_steps_are_long_for_the_motion_does_not_pause_for_it():
    """Two receivers are wrong in turn, 10 m too long for twenty steps: both are far off what the others say."""
    scenarios = {rules: runs("dt=2", "steps=100", f"filter.defaults={rules}", seeds=4, first=1003) for rules in (9, 10)}
    heard = []
    for scenario in scenarios[10]:
        honest = heard_in(Plan(scenario), make_world(scenario))
        ranges = honest.ranges.copy()
        ranges[0, 58:78] += 10.0
        ranges[5, 71:91] += 10.0
        heard.append(Heard(honest.positions, ranges, honest.age))
    before, today = (
        np.array([off(trace)[:, -1].max() for trace in simulate(each, heard=heard)]) for each in scenarios.values()
    )
    assert before.max() > 50.0
    assert today.max() < 25.0


def test_they_do_where_ranges_stay_straight_or_the_scenario_tells_of_outliers():
    def supposes(*keys):
        return Plan(load("tracking", list(keys)).scenario).settings.supposes

    assert supposes()
    assert supposes("dt=2", "sensor.outlier_probability=0.1", "filter.defaults=11")
    assert supposes("dt=2", "filter.defaults=9")
    assert not supposes("dt=2")
