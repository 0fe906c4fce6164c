"""Squared ranges, averaged and then linearised, are a centralised filter's; they hold where priors are wide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.analysis.yardsticks import centralized_run
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.legacy import as_meant
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters import Belief, FilterSettings, make_filter, sharing_of
from zenoh_cbef.tracking.filters.models.slots import Slots
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours

STD, DT, COUNT = 0.3, 0.5, 5
PLANE = "agents.low=[-10,-10,0]", "agents.high=[10,10,0]"
LINE = (
    "agents.count=4",
    "agents.positions=[[-10,0,0],[-4,0,0],[3,0,0],[10,0,0]]",
    "filter.planar_height=0",
    "target.motion=waypoints",
    "target.waypoints=[[-3,-4,0],[3,8,0]]",
    "target.speed=0.45",
    "filter.acceleration_std=0.3",
)


def settings_of(space, xi=np.inf):
    motion = NearlyConstantVelocity(DT, 0.5, space.axes)
    return FilterSettings(motion, space, STD, xi, COUNT, middle=(1.0, -2.0, 3.0)[: space.axes], squares=True)


def scene(space, seed=3, ages=0.0):
    """One prior that all agents share, and their ranges, of which the first is missing."""
    random = np.random.default_rng(seed)
    size = 2 * space.axes
    root = random.normal(scale=0.8, size=(size, size))
    belief = Belief(
        np.repeat(random.normal(scale=2.0, size=(1, size)), COUNT, axis=0),
        np.repeat((root @ root.T + np.eye(size))[None], COUNT, axis=0),
    )
    ranges = random.uniform(3.0, 8.0, COUNT)
    ranges[0] = np.nan
    return belief, Measurement(
        random.normal(scale=5, size=(COUNT, 3)), ranges, np.full(COUNT, ages), *no_neighbours(COUNT)
    )


def concluded(chosen, belief, measurement):
    """What agents believe that learn the exact average."""
    update = chosen.update(belief, measurement)
    average = np.repeat(update.payload.mean(axis=0)[None], len(update.payload), axis=0)
    return chosen.conclude(average, update), update


@pytest.mark.parametrize("space", [Space(), Space(0.7)])
def test_it_is_kalmans_update_of_the_position_and_its_square(space):
    """In covariance form, with the joint moments of (x, |p|^2), counted from the origin."""
    settings = settings_of(space)
    belief, measurement = scene(space)
    found, _ = concluded(make_filter("sicf", settings), belief, measurement)
    axes, size, motion = space.axes, settings.motion.size, settings.motion
    state = motion.predict_state(belief.state)[0]
    covariance = motion.predict_covariance(belief.known_covariance)[0]
    place = covariance[:axes, :axes]
    slope = np.zeros(size)
    slope[:axes] = 2.0 * state[:axes]
    mean = np.append(state, state[:axes] @ state[:axes] + np.trace(place))
    cross = covariance @ slope
    joint = np.block([[covariance, cross[:, None]], [cross, slope @ cross + 2.0 * np.sum(place * place)]])
    for agent in range(1, COUNT):
        at, heard = measurement.position[agent], measurement.range[agent]
        high = 0.0 if space.height is None else (space.height - at[2]) ** 2
        away = state[:axes] - at[:axes]
        square = away @ away + high + np.trace(place)
        uncertain = (away @ place @ away + 0.5 * np.sum(place * place)) / square
        gain = uncertain / (uncertain + STD**2)
        distance = np.sqrt(square) + gain * (heard - np.sqrt(square))
        row = np.zeros(size + 1)
        row[:axes], row[-1] = -2.0 * at[:axes], 1.0
        noise = (4.0 * distance**2 + 2.0 * STD**2) * STD**2
        total = row @ joint @ row + noise
        value = heard**2 + (4.0 * gain - 1.0) * STD**2 - high - at[:axes] @ at[:axes]
        column = joint @ row / total
        mean = mean + column * (value - row @ mean)
        joint = joint - np.outer(column, column) * total
    np.testing.assert_allclose(found.state[0], mean[:size], rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found.known_covariance[0], joint[:size, :size], rtol=1e-7, atol=1e-9)


def test_the_noise_of_a_square_is_as_long_as_is_said():
    """Least squares on noisy squares with these weights and this mean find the true square, to second order."""
    random = np.random.default_rng(5)
    distance = 20.0
    for prior_std in (0.01, STD, 100.0):
        gain = prior_std**2 / (prior_std**2 + STD**2)
        noise = STD * random.normal(size=400_000)
        off = min(prior_std, 3.0) * random.normal(size=noise.size)
        middle = distance + (1.0 - gain) * off + gain * noise
        weight = 1.0 / (4.0 * middle**2 + 2.0 * STD**2)
        square = (distance + noise) ** 2 + (4.0 * gain - 1.0) * STD**2
        error = np.sum(weight * square) / np.sum(weight) - distance**2
        assert abs(error) < 0.5 * STD**2


def test_a_plane_of_agents_says_nothing_across_itself_while_the_target_may_be_on_either_side():
    space = Space()
    chosen = make_filter("icf", settings_of(space))
    _, measurement = scene(space)
    flat = measurement.position.copy()
    flat[:, 2] = 0.0
    wide = np.diag([4.0, 4.0, 4.0, 1e-6, 1e-6, 1e-6])
    belief = Belief(np.zeros((COUNT, 6)), np.repeat(wide[None], COUNT, axis=0))
    found, update = concluded(chosen, belief, replace(measurement, position=flat))
    before, after = update.kept[1][0, 2, 2], found.known_covariance[0, 2, 2]
    assert found.state[0, 2] == pytest.approx(0.0, abs=1e-9)
    assert after == pytest.approx(before)
    assert found.known_covariance[0, 0, 0] < 0.5 * before


def test_a_late_beacon_is_of_where_the_target_was():
    """The same ranges, as of now and as of a while ago at a target that has moved on since."""
    still, age = make_filter("icf", replace(settings_of(Space()), motion=NearlyConstantVelocity(DT, 1e-6))), 0.2
    belief, measurement = scene(Space())
    sure = belief.known_covariance * np.diag([1.0, 1.0, 1.0, 1e-9, 1e-9, 1e-9])
    belief = Belief(belief.state, sure)
    moved = belief.state.copy()
    moved[:, :3] += age * moved[:, 3:]
    now, _ = concluded(still, belief, measurement)
    late, _ = concluded(still, Belief(moved, sure), replace(measurement, age=np.full(COUNT, age)))
    expected = now.state[0, :3] + age * now.state[0, 3:]
    np.testing.assert_allclose(late.state[0, :3], expected, atol=1e-5)


def test_an_agent_is_a_batch_of_one():
    chosen = make_filter("sicf", settings_of(Space(), xi=1.5))
    belief, measurement = scene(Space(), ages=0.1)
    update = chosen.update(belief, measurement)
    mixed = update.payload[::-1].copy()
    whole = chosen.conclude(mixed, update)
    for agent in range(COUNT):
        one = slice(agent, agent + 1)
        mine = Measurement(measurement.position[one], measurement.range[one], measurement.age[one], *no_neighbours(1))
        alone = chosen.update(Belief(belief.state[one], belief.known_covariance[one]), mine)
        np.testing.assert_array_equal(alone.payload, update.payload[one])
        np.testing.assert_array_equal(chosen.conclude(mixed[one], alone).state, whole.state[one])


def test_messages_are_longer_by_one_state():
    for squares, numbers in ((False, 27), (True, 35)):
        assert sharing_of("sicf", replace(settings_of(Space()), squares=squares)).payload_size == numbers


def traces_of(*overrides, seeds):
    return simulate([load("tracking", [*overrides, f"seed={seed}"]).scenario for seed in seeds])


def worst(trace):
    return np.sqrt(np.mean(np.sum((trace.estimates - trace.truth)[:, 75:, :3] ** 2, axis=2), axis=1)).max()


@pytest.mark.slow
def test_a_target_that_crosses_a_line_of_agents_is_not_taken_for_its_mirror_image():
    # By later rules ranges also tell how little this target accelerates.
    before = ["filter.linearise=before", "filter.defaults=12"]
    kept, lost = (worst(*traces_of(*LINE, *more, seeds=[1018])) for more in ([], before))
    assert kept < 0.3
    assert lost > 5.0


@pytest.mark.parametrize(("rules", "between"), [(24, True), (25, False)])
def test_an_estimate_does_not_stay_in_the_plane_of_six_agents(rules, between):
    """In the middle between the target, which begins there, and its mirror image: no range tells which one it is."""
    for trace in traces_of(*PLANE, "steps=200", f"filter.defaults={rules}", seeds=[1030, 1042, 1046]):
        true, found = abs(trace.truth[-1, 2]), np.abs(trace.estimates[:, -1, 2])
        assert true > 1.9
        np.testing.assert_allclose(found, 0.0 if between else true, atol=0.5)


@pytest.mark.slow
def test_long_steps_are_tracked_as_well_as_by_a_centralised_filter():
    """Linearised before averaging one of these seeds is lost. The network is honest about its errors, too."""
    # The NEES of one seed scatters by 0.3, the mean of 32 by 0.05.
    every = traces_of("dt=5", "steps=120", seeds=range(1001, 1033))
    before = traces_of("dt=5", "steps=120", "filter.linearise=before", seeds=range(1001, 1009))
    for traces, lost in (before, True), (every[:8], False):
        states = np.stack([belief.state for belief in centralized_run(traces, 120)], axis=1)
        central = [
            np.sqrt(np.mean(np.sum((state - one.truth)[75:, :3] ** 2, axis=1)))
            for state, one in zip(states, traces, strict=True)
        ]
        assert bool((np.array([worst(one) for one in traces]) > 1.5 * np.array(central)).any()) is lost
    errors = np.stack([(trace.estimates - trace.truth)[:, 75:] for trace in every])
    covariances = np.stack([trace.covariances[:, 75:] for trace in every])
    nees = np.sum(errors * np.linalg.solve(covariances, errors[..., None])[..., 0], axis=-1)
    assert nees.mean() / 6.0 == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize(
    "overrides",
    [
        ("dt=0.5", "target.acceleration_std=10", "filter.defaults=11"),
        ("dt=5", "filter.defaults=11"),
        ("agents.count=3",),
        (*PLANE, "filter.defaults=24"),
        ("agents.positions=[[0,0,1],[5,0,1],[0,5,1],[5,5,1],[2,3,1],[3,2,1]]", "filter.defaults=24"),
        ("agents.count=2", "filter.planar_height=0"),
        ("filter.linearise=after",),
    ],
)
def test_the_network_linearises_after_averaging_where_priors_may_be_wide(overrides):
    assert {Plan(load("tracking", [*overrides, f"seed={seed}"]).scenario).squares for seed in range(5)} == {True}


@pytest.mark.parametrize(
    "overrides",
    [
        (),
        PLANE,
        ("agents.count=4", *PLANE),
        ("agents.positions=[[0,0,1],[5,0,1],[0,5,1],[5,5,1],[2,3,1],[3,2,1]]",),
        ("agents.count=3", "filter.planar_height=0"),
        ("agents.count=2",),
        ("agents.positions=[[0,0,1],[5,0,1],[1,0,1],[9,0,1],[2,0,1],[3,0,1]]",),
        ("agents.count=3", "filter.kind=ci"),
        ("agents.count=3", "sensor.bias=0.3"),
        ("agents.count=3", "filter.defaults=1"),
        ("agents.count=3", "filter.linearise=before"),
        ("dt=0.5", "target.acceleration_std=10", "filter.defaults=3"),
        ("agents.count=3", "target.motion=circle"),
        ("dt=5", 'fault=[{kind="byzantine",mode="constant",magnitude=5.0,agents=[3]}]'),
    ],
)
def test_elsewhere_it_linearises_before(overrides):
    assert not Plan(load("tracking", overrides).scenario).squares


def test_an_older_log_means_linearising_before():
    assert parse(as_meant({"filter": {"defaults": 2}}), "a log").filter.linearise == "before"


def test_a_filter_that_cannot_is_refused():
    with pytest.raises(UserError, match="linearise = 'after' is not for 'ci'"):
        load("tracking", ["filter.kind=ci", "filter.linearise=after"])


def test_a_range_below_zero_is_none_for_its_square_is_that_of_another():
    def said(value, least=0.0):
        belief, heard = scene(Space())
        heard.range[1] = value
        return make_filter("sicf", replace(settings_of(Space()), least=least)).update(belief, heard).payload

    np.testing.assert_array_equal(said(-45.0), said(np.nan))
    assert (said(-45.0, -np.inf) != said(np.nan)).any()
    assert (said(0.0) != said(np.nan)).any()


def test_agents_that_tell_their_ranges_tell_none_below_zero_and_hear_none():
    _, heard = scene(Space())
    heard.range[1] = -45.0
    slots = Slots(Space(), STD, (0.0, 0.0, 0.0), COUNT, 0.0)
    assert slots.told(heard)[:, 0].tolist() == [0.0, 0.0, 1.0, 1.0, 1.0]
    own = slots.at(heard.position[:, None], heard.range[:, None], heard.age[:, None], np.ones((COUNT, 1)))
    assert np.isnan(own.range[:, 0]).tolist() == [True, True, False, False, False]
