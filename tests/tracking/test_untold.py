"""Wrong ranges of which a scenario says nothing do not lose agents that average what several motions say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import Heard, heard_in, simulate
from zenoh_cbef.tracking.filters.weighing import saturation
from zenoh_cbef.tracking.outliers import Untold, wrong_by_any
from zenoh_cbef.tracking.status import STATUSES

CIRCLE = "target.motion=circle", "target.radius=5", "target.period=8"
CORNERS = (
    "target.motion=waypoints",
    "target.speed=4",
    "target.waypoints=[[0,0,0],[5,5,5],[-5,5,-5],[5,-5,5],[-5,-5,-5],[0,0,0]]",
)
REAL_TIME, MANY = "timing.mode=realtime", "agents.count=13"
XI = 1.5
TRACKING = STATUSES.index("tracking")


@given(st.floats(-30.0, 30.0), st.floats(1e-4, 100.0), st.floats(1e-4, 1.0))
def test_a_range_saturates_and_counts_as_much_as_it_is_likely_right(innovation, prior, noise):
    errors, spread = Untold.of(float(np.sqrt(noise)), XI), float(np.sqrt(prior + noise))
    saturated = noise / saturation(np.array([innovation]), np.array([XI * spread]))[0]
    total = prior + saturated
    right = (1.0 - errors.share) * np.exp(-0.5 * innovation**2 / total) / np.sqrt(2.0 * np.pi * total)
    wrong = errors.share * float(np.exp(wrong_by_any(np.array(innovation), np.array(spread**2), errors.size)))
    found = errors.informed(*(np.array([one]) for one in (innovation, spread, noise)))
    assert found.precision[0] * saturated == pytest.approx(right / (right + wrong), rel=1e-9, abs=1e-12)
    assert found.pull[0] == pytest.approx(found.precision[0] * innovation, rel=1e-9)
    after = 1.0 / (1.0 / prior + found.precision[0])
    cost = found.cost[0] + np.log(prior / after) - found.pull[0] ** 2 * after
    assert cost == pytest.approx(-2.0 * np.log(right + wrong), rel=1e-6, abs=1e-6)


def test_among_ranges_that_are_surely_right_it_is_the_saturation():
    innovation, spread, noise = np.array([-0.3, 0.0, 0.2, 0.9]), np.full(4, np.sqrt(0.05)), np.full(4, 0.01)
    found, weight = Untold(1e-12, 5.0, XI).informed(innovation, spread, noise), saturation(innovation, XI * spread)
    np.testing.assert_allclose(found.precision, weight / noise, rtol=1e-6)
    cost = weight * innovation**2 / noise - np.log(weight)
    np.testing.assert_allclose(found.cost, cost + np.log(2.0 * np.pi * noise), rtol=1e-6)


@given(st.floats(0.01, 10.0), st.floats(0.0, 100.0))
def test_the_density_of_wrong_ranges_is_one(size, variance):
    away = np.concatenate([[0.0], np.geomspace(1e-6, 1e9, 20001)])
    density = np.exp(wrong_by_any(away, np.full(len(away), variance), size))
    assert 2.0 * np.trapezoid(density, away) == pytest.approx(1.0, abs=1e-3)


def with_wrong(scenario, kind):
    """What receivers hear, of which four of ten ranges are 30 m too long, or all of two agents for two seconds."""
    heard = heard_in(Plan(scenario), make_world(scenario))
    ranges = heard.ranges.copy()
    if kind == "bursts":
        ranges[0, 75:95] += 10.0
        ranges[-1, 100:120] += 10.0
    else:
        ranges += 30.0 * (np.random.default_rng(scenario.seed).random(ranges.shape) < 0.4)
    return Heard(heard.positions, ranges, heard.age)


@pytest.mark.slow
@pytest.mark.parametrize("wrong", ["40 %", "bursts"])
@pytest.mark.parametrize("where", [REAL_TIME, MANY])
@pytest.mark.parametrize("path", [CIRCLE, CORNERS])
def test_a_target_that_turns_is_held_where_agents_average(path, where, wrong):
    scenarios = [load("tracking", [*path, where, "steps=150", "seed=1001"]).scenario]
    assert not Plan(scenarios[0]).tells_ranges
    for trace in simulate(scenarios, heard=[with_wrong(one, wrong) for one in scenarios]):
        off = np.linalg.norm((trace.estimates - trace.truth)[:, 60:, :3], axis=2)
        assert np.sqrt(np.mean(off**2)) < 0.5
        # Of six agents two may have all right ranges of the step after a corner.
        assert ((trace.diagnostics.status[:, 60:] == TRACKING) & (off > 1.0)).mean() < 0.03


@pytest.mark.parametrize("key", ["filter.saturation=bounded", "filter.xi=2", "filter.kind=icf", "filter.defaults=17"])
def test_where_the_scenario_asks_for_saturation_ranges_saturate(key):
    assert Plan(load("tracking", [*CIRCLE, MANY]).scenario).settings.weighed == Untold(0.02, 5.0, XI, bursts=True)
    assert Plan(load("tracking", [*CIRCLE, MANY, key]).scenario).settings.weighed is None
    assert Plan(load("tracking", []).scenario).settings.weighed is None
