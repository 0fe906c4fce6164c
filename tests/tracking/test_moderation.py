"""No message makes an estimate infinite, and agents that heard none of it compute what they would have computed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.scenario.build import agent_tracker, batch_tracker
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import heard_in, measured
from zenoh_cbef.tracking.consensus import Average
from zenoh_cbef.tracking.filters import KINDS, Belief
from zenoh_cbef.tracking.filters.information_form import pack
from zenoh_cbef.tracking.moderation import LARGEST, LARGEST_SENT, is_moderate, is_within
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours
from zenoh_cbef.tracking.tracker import Tracker

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # what overflows is the point here

WILD = st.sampled_from([1e90, 1e101, 1e160, -1e200, 1e308, -1e308])


@pytest.mark.parametrize("rows", [1, 80])
@pytest.mark.parametrize("limit", [LARGEST_SENT, LARGEST])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.4, 0.7, -0.7, -1.0, 1.0, 1.0000001, -2.0, 1e99, np.inf, -np.inf, np.nan])
def test_one_number_of_many_tells_whether_all_are_within_a_limit(share: float, limit: float, rows: int) -> None:
    values = np.full((rows, 5, 31), 0.6 * limit)
    for others in (values, np.zeros_like(values), values[:, :0], values.swapaxes(1, 2)):
        assert is_within(limit, others)
        for place in range(0, others.size, 29 * rows):
            tried = others.copy()
            tried.flat[place] = share * limit
            assert is_within(limit, tried) == (abs(share) <= 1.0)


@pytest.mark.parametrize(("share", "within"), [(1.0, True), (-1.0, True), (1.1, False), (-1.1, False), (np.nan, False)])
def test_one_number_of_a_million_tells_it_too(share: float, within: bool) -> None:
    values = np.zeros(1_000_001)
    values[-1] = share * LARGEST
    assert is_within(LARGEST, values) is within


@pytest.mark.parametrize("kind", sorted(KINDS))
@settings(deadline=None, max_examples=8)
@given(told=WILD, payload=WILD, step=st.integers(0, 3))
def test_no_message_makes_an_estimate_infinite(kind: str, told: float, payload: float, step: int) -> None:
    scenario = load("tracking", ["steps=5", "agents.count=4", "network.graph=ring", f"filter.kind={kind}"]).scenario
    plan = Plan(scenario)
    heard = heard_in(plan, make_world(scenario))
    batch, neighbours = batch_tracker([plan])
    alone = [agent_tracker(plan, agent)[0] for agent in range(4)]
    index, several = neighbours.index, plan.sharing.uses_neighbour_ranges

    def measurement(rows: list[int], k: int) -> Measurement:
        ids = index[rows] if several else index[rows][:, :0]
        places, ranges = heard.positions[ids, k], heard.ranges[ids, k].copy()
        if k == step and several and 0 in rows:
            ranges[rows.index(0), 0] = told
        return Measurement(heard.positions[rows, k], heard.ranges[rows, k], heard.age[rows, k], places, ranges)

    for k in range(5):
        sent = batch.measure(measurement([0, 1, 2, 3], k))
        single = [one.measure(measurement([agent], k)) for agent, one in enumerate(alone)]
        for round_ in range(3):
            assert all((sent[agent] == one[0]).all() for agent, one in enumerate(single))
            received = sent[index]
            if k == step and round_ == 2:
                received[0, 0] = payload
            sent = batch.exchange(received, neighbours.present)
            single = [one.exchange(received[[agent]], None) for agent, one in enumerate(alone)]
        estimate = batch.conclude()
        assert np.isfinite(estimate.state).all()
        for agent, one in enumerate(alone):
            own = one.conclude()
            assert own.state.tobytes() == estimate.state[agent].tobytes()
            assert own.refused[0] == estimate.refused[agent]
        if k != step:
            assert not estimate.refused.any()


def test_an_agent_that_becomes_sure_or_far_beyond_measure_takes_back_what_it_heard() -> None:
    """Information without bounds is a moderate place with hardly any covariance: only the message shows it."""
    plan = load("tracking", ["filter.start=given", "filter.kind=sicf", "filter.status=false"]).plan
    begin = Belief(np.array([[1.0, 2.0, 3.0, 0.3, 0.2, 0.1]]), 0.25 * np.eye(6)[None])
    seen = Measurement(np.array([[5.0, 0.0, 1.0]]), np.array([4.0]), np.zeros(1), *no_neighbours(1))
    # At last a message that is moderate once it is averaged, and leaves a place that is not.
    for size, certainty, refused in ((1e20, 1e20, False), (1e110, 1e110, True), (1.9e100, 0.0, True)):
        tracker = Tracker(plan.filter, Average(np.full((1, 1), 0.5)), plan.space, begin)
        tracker.measure(seen)
        tracker.exchange(pack(size * np.ones((1, 6)), certainty * np.eye(6)[None])[None], None)
        estimate = tracker.conclude()
        assert estimate.covariance is not None
        if not refused:
            np.testing.assert_allclose(estimate.state, 1.0, rtol=1e-9)
            assert not estimate.refused[0]
            continue
        transition = np.kron([[1.0, plan.motion.dt], [0.0, 1.0]], np.eye(3))
        np.testing.assert_allclose(estimate.state[0], transition @ begin.state[0], rtol=1e-9)
        expected = 0.25 * transition @ transition.T + plan.motion.process_noise
        np.testing.assert_allclose(estimate.covariance[0], expected, rtol=1e-9, atol=1e-12)
        assert estimate.refused[0]


def test_a_belief_is_moderate_where_all_its_numbers_are() -> None:
    near, far = np.ones((1, 6)), np.full((1, 6, 6), 1e200)
    assert is_moderate(Belief(near, np.eye(6)[None])) is True
    assert is_moderate(Belief(far[0, :1], np.eye(6)[None])) is False
    assert is_moderate(Belief(near, far)) is False
    assert is_moderate(Belief(near, None, parts=(Belief(near, far),))) is False


def test_a_step_cannot_end_before_it_began() -> None:
    plan = load("tracking").plan
    tracker = Tracker(plan.filter, Average(np.zeros((1, 0))), plan.space, Belief(np.zeros((1, 6)), np.eye(6)[None]))
    with pytest.raises(RuntimeError, match="after measure"):
        tracker.conclude()


@pytest.mark.parametrize(
    ("emitted", "arrived"), [(1e200, 0.1), (0.1, 1e200), (1e200, 1e200), (0.1, 1e9), (-1e308, 1e308), (0.1, -1.0)]
)
def test_a_range_out_of_all_proportion_is_no_range(emitted: float, arrived: float) -> None:
    plan = load("tracking").plan
    times = np.array(emitted), np.array(arrived)
    found, age = measured(plan, *times, 1)
    assert np.isnan([found, age]).all()


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["sensor.outlier_probability=0.5", "sensor.outlier_scale=1000.0"],
        ['fault=[{kind="sensor-spikes", probability=1.0, std=1e4}]'],
        ['fault=[{kind="sensor-bias", bias=-1e7}]'],
        ['fault=[{kind="clock", offset=-5.0}]'],
        ["agents.low=-1e6", "agents.high=1e6"],
        ["target.position=[1e7, 0.0, 0.0]", "steps=2000"],
        ["target.velocity=[1e4, 0.0, 0.0]", "dt=10.0"],
        ["target.acceleration_std=1e3", "steps=3000"],
        ["sensor.range_std=1e-9", "sensor.signal_speed=1.0"],
        ["agents.motion=formation", "agents.velocity=[100.0, 0.0, 0.0]"],
        ["target.motion=circle", "target.radius=1e5", "target.period=1e5"],
    ],
)
def test_what_a_scenario_emulates_is_plausible(overrides: list[str]) -> None:
    scenario = load("tracking", overrides).scenario
    world = make_world(scenario)
    ranges = heard_in(Plan(scenario), world).ranges
    assert (np.isfinite(ranges) == np.isfinite(world.emitted)).all()
