"""The emulated world moves as its scenario says, and its receivers err as much as it says."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.courses.waypoints import along
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.paths import agent_positions
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world, target_path, target_start
from zenoh_cbef.simulator import heard_in
from zenoh_cbef.tracking.motion import NearlyConstantVelocity

SQUARE = [[0, 0, 0], [4, 0, 0], [4, 3, 0], [4, 3, 0], [0, 3, 5]]


def scenario(**keys):
    return parse({"steps": 50, **keys}, "test")


def test_ncv_increments_have_the_covariance_of_the_model():
    one = scenario(steps=40_000, dt=0.5, target={"acceleration_std": 0.8, "velocity": [1, 2, 3]})
    path, model = target_path(one), NearlyConstantVelocity(0.5, 0.8)
    increments = path[1:] - path[:-1] @ model.transition.T
    covariance = increments.T @ increments / len(increments)
    expected = model.process_noise
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (np.abs(covariance - expected) / scale).max() < 6 * np.sqrt(2 / len(increments))
    assert (np.abs(increments.mean(axis=0)) < 6 * np.sqrt(np.diag(expected) / len(increments))).all()


def test_ncv_accelerations_are_constant_within_a_step_and_independent_between_steps():
    one = scenario(steps=20_000, dt=0.5, target={"acceleration_std": 0.8})
    path = target_path(one)
    acceleration = np.diff(path[:, 3:], axis=0) / 0.5
    moved = path[:-1, :3] + 0.5 * path[:-1, 3:] + 0.125 * acceleration
    np.testing.assert_allclose(path[1:, :3], moved, rtol=1e-9, atol=1e-6)
    columns = np.concatenate([acceleration[1:], acceleration[:-1]], axis=1)
    correlation = np.corrcoef(columns.T) - np.eye(6)
    assert np.abs(correlation).max() < 6 / np.sqrt(len(acceleration))


def test_ncv_without_noise_is_a_straight_line_from_the_start():
    one = scenario(dt=0.1, target={"position": [1, 2, 3], "velocity": [4, 5, 6], "acceleration_std": 0})
    path = target_path(one)
    assert path[0].tolist() == [1, 2, 3, 4, 5, 6] == target_start(one).tolist()
    np.testing.assert_allclose(path[50, :3], [21, 27, 33], rtol=1e-12)


@pytest.mark.parametrize("motion", ["circle", "lemniscate", "waypoints"])
def test_velocities_are_the_finite_differences_of_positions(motion):
    keys = {"motion": motion, "position": [1, -2, 3], "radius": 4.0, "period": 7.0, "speed": 0.8}
    one = scenario(steps=20_000, dt=0.001, target={**keys, "waypoints": SQUARE})
    path = target_path(one)
    central = (path[2:, :3] - path[:-2, :3]) / 0.002
    error = np.abs(central - path[1:-1, 3:]).max(axis=1)
    if motion == "waypoints":
        # At a corner the difference spans two legs.
        assert (error > 1e-9).sum() <= 2 * len(SQUARE)
    else:
        assert error.max() < 1e-5


def test_a_circle_has_its_radius_period_and_centre():
    one = scenario(steps=300, dt=0.1, target={"motion": "circle", "position": [1, 2, 3], "radius": 4.0, "period": 30.0})
    path = target_path(one)
    np.testing.assert_allclose(np.linalg.norm(path[:, :3] - [1, 2, 3], axis=1), 4.0, rtol=1e-12)
    np.testing.assert_allclose(path[300], path[0], atol=1e-9)
    np.testing.assert_allclose(path[150, :3] - [1, 2, 3], -(path[0, :3] - [1, 2, 3]), atol=1e-9)
    assert target_start(one).tolist() == path[0].tolist()


def test_a_lemniscate_crosses_its_centre_twice_a_period():
    one = scenario(steps=40, dt=0.5, target={"motion": "lemniscate", "position": [1, 2, 3], "period": 20.0})
    distance = np.linalg.norm(target_path(one)[:, :3] - [1, 2, 3], axis=1)
    assert np.flatnonzero(distance < 1e-9).tolist() == [0, 20, 40]
    assert distance.max() <= 5.0 * 1.0001


def test_a_body_follows_its_points_at_its_speed_and_rests_at_the_last():
    times = np.array([0.0, 2.0, 4.0, 5.5, 7.0, 7.0 + np.sqrt(41.0), 100.0])
    states = along(np.array(SQUARE, dtype=float), 1.0, times)
    expected = np.array([[0, 0, 0], [2, 0, 0], [4, 0, 0], [4, 1.5, 0], [4, 3, 0], [0, 3, 5], [0, 3, 5]])
    np.testing.assert_allclose(states[:, :3], expected, atol=1e-12)
    speeds = np.linalg.norm(states[:, 3:], axis=1)
    np.testing.assert_allclose(speeds[[0, 1, 2, 3, 4, 6]], [1, 1, 1, 1, 1, 0], atol=1e-12)
    assert np.isfinite(states).all()


@pytest.mark.parametrize("points", [[[1, 2, 3]], [[1, 2, 3], [1, 2, 3]]])
def test_a_body_with_nowhere_to_go_rests(points):
    states = along(np.array(points, dtype=float), 2.0, np.array([0.0, 1.0]))
    assert states.tolist() == [[1, 2, 3, 0, 0, 0]] * 2


def test_agents_rest_drift_or_follow_their_points():
    places = [[0, 0, 0], [1, 2, 3]]
    static = agent_positions(scenario(agents={"positions": places}))
    assert (static == np.array(places)[:, None, :]).all()
    drifting = agent_positions(
        scenario(dt=0.5, agents={"positions": places, "motion": "formation", "velocity": [1, 0, -2]})
    )
    np.testing.assert_allclose(drifting[:, 9] - places, [[5.0, 0.0, -10.0]] * 2, atol=1e-12)
    walking = agent_positions(
        scenario(
            dt=0.5,
            agents={"count": 2, "motion": "waypoints", "waypoints": [SQUARE, [[7, 7, 7]]], "speed": 2.0},
        )
    )
    np.testing.assert_allclose(walking[0, :4, :2], [[1, 0], [2, 0], [3, 0], [4, 0]], atol=1e-12)
    assert (walking[1] == 7.0).all()


def test_uniform_placement_fills_its_box_and_depends_on_the_seed():
    box = {"count": 500, "low": [-1, 5, 0], "high": [1, 6, 0.5]}
    places = agent_positions(scenario(steps=1, agents=box))[:, 0]
    low, high = np.array(box["low"]), np.array(box["high"])
    assert (places >= low).all()
    assert (places <= high).all()
    assert (np.abs(places.mean(axis=0) - (low + high) / 2) < 6 * (high - low) / np.sqrt(12 * 500)).all()
    other = agent_positions(scenario(steps=1, seed=2, agents=box))[:, 0]
    assert (places != other).all()


def errors(**sensor):
    """Range errors (n, K) of eight agents over many steps; NaN where nothing was heard."""
    keys = {"count": 8, "low": 50.0, "high": 60.0}
    one = scenario(steps=20_000, dt=0.01, agents=keys, sensor=sensor, target={"acceleration_std": 0.0})
    world = make_world(one)
    distance = np.linalg.norm(world.truth[None, :, :3] - world.positions, axis=2)
    return heard_in(Plan(one), world).ranges - distance


def test_range_noise_has_its_standard_deviation_and_no_bias():
    error = errors(range_std=0.3)
    assert np.isfinite(error).all()
    assert abs(error.mean()) < 6 * 0.3 / np.sqrt(error.size)
    assert abs(error.std() / 0.3 - 1.0) < 6 / np.sqrt(2 * error.size)
    correlation = np.corrcoef(error) - np.eye(8)
    assert np.abs(correlation).max() < 6 / np.sqrt(error.shape[1])


def test_biases_are_constant_per_agent():
    means = errors(range_std=0.1, bias=[0.1 * agent for agent in range(8)]).mean(axis=1)
    np.testing.assert_allclose(means, 0.1 * np.arange(8), atol=6 * 0.1 / np.sqrt(20_000))
    spread = errors(range_std=0.1, bias=2.0, bias_std=0.5).mean(axis=1)
    assert abs(spread.mean() - 2.0) < 6 * 0.5 / np.sqrt(8)
    assert 0.1 < spread.std() < 1.5


def test_outliers_come_at_their_rate_and_only_lengthen_ranges():
    error = errors(range_std=0.001, outlier_probability=0.1, outlier_scale=5.0)
    hit = error > 0.01
    # exp(-0.01 / 5) of the outliers are longer than the threshold.
    assert abs(hit.mean() - 0.1 * np.exp(-0.002)) < 6 * np.sqrt(0.09 / error.size)
    assert abs(error[hit].mean() - 5.0) < 6 * 5.0 / np.sqrt(hit.sum())
    assert error.min() > -0.01


def test_drop_outs_come_at_their_rate():
    error = errors(dropout_probability=0.2)
    assert abs(np.isnan(error).mean() - 0.2) < 6 * np.sqrt(0.16 / error.size)
    assert np.isnan(errors(dropout_probability=1.0)).all()


def test_a_range_is_never_negative():
    one = scenario(agents={"positions": [[0, 0, 0]]}, sensor={"range_std": 5.0})
    ranges = heard_in(Plan(one), make_world(one)).ranges
    assert ranges.min() == 0.0


@pytest.mark.parametrize("speed", [299_792_458.0, 343.0])
def test_times_of_flight_keep_ranges_to_the_resolution_of_the_clock(speed):
    one = scenario(steps=3000, dt=0.1, sensor={"range_std": 1e-9, "signal_speed": speed})
    world = make_world(one)
    distance = np.linalg.norm(world.truth[None, :, :3] - world.positions, axis=2)
    heard = heard_in(Plan(one), world)
    assert np.abs(heard.ranges - distance).max() < np.spacing(301.0) * speed + 1e-8
    assert (heard.age == 0.0).all()
    np.testing.assert_allclose(world.time, 0.1 * np.arange(1, 3001))


def test_noise_does_not_change_with_the_number_of_agents_or_steps():
    places = [[n, 2 * n, -n] for n in range(6)]
    whole = make_world(scenario(steps=40, agents={"positions": places}))
    part = make_world(scenario(steps=10, agents={"positions": places[:2]}))
    assert whole.arrived[:2, :10].tobytes() == part.arrived.tobytes()


def test_a_steered_target_goes_to_its_orders_at_its_speed_and_a_later_order_changes_no_past():
    orders = [{"to": [3, 4, 0], "from": 1.0}, {"to": [0, 4, 2], "from": 4.0, "until": 5.0}]
    keys = {"motion": "manual", "position": [0, 0, 0], "speed": 2.0}
    first, both = (target_path(scenario(dt=0.1, target=keys | {"orders": orders[:count]})) for count in (1, 2))
    np.testing.assert_array_equal(first[:40], both[:40])
    assert not both[:10].any()
    np.testing.assert_allclose(both[10, :3], [0.12, 0.16, 0.0])
    np.testing.assert_allclose(np.linalg.norm(both[11:30, 3:], axis=1), 2.0)
    np.testing.assert_allclose(both[35], [3, 4, 0, 0, 0, 0], atol=1e-9)
    assert both[49, 0] < 3.0
    # Without an order that is on, the first one holds again.
    assert both[50, 0] > both[49, 0]
    assert not target_path(scenario(target={"motion": "manual"}))[:, :3].any()
