"""The strong yardstick is right where the answer is known, and holds where the extended filter is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.analysis.prior import known_together
from zenoh_cbef.analysis.strong import Known, Seen, strong
from zenoh_cbef.analysis.strong.bank import Bank
from zenoh_cbef.analysis.strong.models import Models, Turns
from zenoh_cbef.analysis.strong.ranged import Heard, square_root, update
from zenoh_cbef.analysis.strong.starts import Circles, starts
from zenoh_cbef.analysis.strong.told import told, wrong_ranges
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate

RANDOM = np.random.default_rng(7)


def heard(anchor, ranges, *, age=None, std=0.1, heavy=np.inf, biased=False):
    anchor, ranges = np.asarray(anchor, dtype=float)[None], np.asarray(ranges, dtype=float)[None]
    ages = np.zeros_like(ranges) if age is None else np.asarray(age, dtype=float)[None]
    return Heard(anchor, np.zeros_like(ranges), ranges, ages, std**2, heavy, biased)


def test_the_square_root_is_cholesky_s():
    factor = RANDOM.normal(size=(4, 5, 5))
    matrices = factor @ np.swapaxes(factor, 1, 2)
    assert square_root(matrices) == pytest.approx(np.linalg.cholesky(matrices))


@pytest.mark.parametrize("moving", [False, True])
def test_far_agents_make_ranges_linear_and_the_update_kalman_s(moving):
    directions = RANDOM.normal(size=(5, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    age = RANDOM.uniform(0.0, 0.3, 5) if moving else np.zeros(5)
    anchor = 1e7 * directions
    factor = RANDOM.normal(size=(11, 11))
    mean, covariance = np.concatenate([RANDOM.normal(size=6), np.zeros(5)]), factor @ factor.T
    rows = np.concatenate([-directions, age[:, None] * directions, np.eye(5)], axis=1)
    noise = RANDOM.normal(size=5)
    ranges = 1e7 + rows @ mean + noise
    found = update(mean[None, None], covariance[None, None], heard(anchor, ranges, age=age, biased=True), passes=3)
    total = rows @ covariance @ rows.T + 0.01 * np.eye(5)
    gain = covariance @ rows.T @ np.linalg.inv(total)
    assert found.mean[0, 0] == pytest.approx(mean + gain @ noise, abs=1e-4)
    assert found.covariance[0, 0] == pytest.approx(covariance - gain @ rows @ covariance, abs=1e-4)
    likelihood = -0.5 * (noise @ np.linalg.solve(total, noise) + np.log(np.linalg.det(2.0 * np.pi * total)))
    assert found.evidence[0, 0] == pytest.approx(likelihood, abs=1e-3)


def grid_posterior(anchor, ranges, std, mean, spread):
    """Mean and covariance of the posterior of a resting target in the plane, and the evidence, by adding up a grid."""
    axis = np.linspace(-12.0, 12.0, 601)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    places = np.stack([x, y], axis=-1)
    density = np.exp(-0.5 * np.sum((places - mean) ** 2, axis=2) / spread**2) / (2.0 * np.pi * spread**2)
    for place, measured in zip(anchor, ranges, strict=True):
        error = measured - np.linalg.norm(places - place, axis=2)
        density *= np.exp(-0.5 * (error / std) ** 2) / np.sqrt(2.0 * np.pi * std**2)
    evidence = density.sum() * (axis[1] - axis[0]) ** 2
    share = density / density.sum()
    middle = np.einsum("xy,xyd->d", share, places)
    apart = places - middle
    return middle, np.einsum("xy,xyd,xye->de", share, apart, apart), np.log(evidence)


def test_a_wide_prior_and_few_ranges_give_the_posterior_of_a_grid():
    anchor, truth = np.array([[-5.0, 0.0], [5.0, 1.0], [0.0, 6.0]]), np.array([1.0, 2.0])
    ranges = np.linalg.norm(truth - anchor, axis=1) + np.array([0.1, -0.2, 0.15])
    mean, covariance, evidence = grid_posterior(anchor, ranges, 0.2, np.array([-3.0, -4.0]), 4.0)
    wide = np.diag([16.0, 16.0, 1.0, 1.0])
    start = np.array([-3.0, -4.0, 0.0, 0.0])
    found = update(start[None, None], wide[None, None], heard(anchor, ranges, std=0.2), passes=8)
    assert found.mean[0, 0, :2] == pytest.approx(mean, abs=0.01)
    assert found.covariance[0, 0, :2, :2] == pytest.approx(covariance, abs=0.003)
    assert found.evidence[0, 0] == pytest.approx(evidence, abs=0.1)


def test_two_ranges_in_a_plane_leave_both_mirror_images_as_the_grid_has_them():
    anchor, truth = np.array([[-5.0, 0.0], [5.0, 0.0]]), np.array([1.0, 3.0])
    ranges = np.linalg.norm(truth - anchor, axis=1)
    mean, covariance, _ = grid_posterior(anchor, ranges, 0.2, np.zeros(2), 4.0)
    places, _ = starts(Circles(anchor[None], np.zeros((1, 2)), ranges[None], 0.2), 2)
    assert sorted(places[0, :, 1]) == pytest.approx([-3.0, 3.0], abs=1e-3)
    states = np.concatenate([places, np.zeros((1, 2, 2))], axis=2)
    spread = np.tile(np.diag([4.0, 4.0, 1.0, 1.0]), (1, 2, 1, 1))
    bank = Bank.of(states, spread, 1).step(Models.of(1e-6, np.array([1e-6]), 2, 0), heard(anchor, ranges, std=0.2), 6)
    found, uncertain = bank.estimate()
    assert found[0, :2] == pytest.approx(mean, abs=0.05)
    assert uncertain[0, :2, :2] == pytest.approx(covariance, rel=0.05, abs=0.05)


def test_with_one_model_and_far_agents_a_run_is_kalman_s():
    steps, dt, std, noise = 12, 0.5, 0.3, 0.2
    directions = np.eye(3)
    anchor = 1e7 * directions
    initial, covariance = np.zeros(6), np.diag([1.0, 2.0, 3.0, 0.5, 0.5, 0.5])
    measured = RANDOM.normal(size=(steps, 3))
    models = Models.of(dt, np.array([noise]), 3, 0)
    bank = Bank.of(initial[None, None], covariance[None, None], 1)
    transition = np.kron([[1.0, dt], [0.0, 1.0]], np.eye(3))
    gain = np.kron([[0.5 * dt**2], [dt]], np.eye(3))
    rows = np.concatenate([-directions, np.zeros((3, 3))], axis=1)
    for step in range(steps):
        bank = bank.step(models, heard(anchor, 1e7 + measured[step], std=std), 2)
        initial = transition @ initial
        covariance = transition @ covariance @ transition.T + noise**2 * gain @ gain.T
        weight = covariance @ rows.T @ np.linalg.inv(rows @ covariance @ rows.T + std**2 * np.eye(3))
        initial, covariance = (
            initial + weight @ (measured[step] - rows @ initial),
            covariance - weight @ rows @ covariance,
        )
    mean, spread = bank.estimate()
    assert mean[0] == pytest.approx(initial, abs=1e-4)
    assert spread[0] == pytest.approx(covariance, abs=1e-4)


def test_turns_are_predicted_as_samples_move():
    """Means and covariances of a turning target are those of many samples, each turned on its own circle."""
    dt, rate_std = 0.5, 0.3
    models = Models.of(dt, np.array([0.0]), 3, 0, (Turns(0.0, rate_std, 0.0),))
    mean = np.array([1.0, 2.0, 3.0, 4.0, -1.0, 0.5, 0.8])
    covariance = np.diag([0.1, 0.2, 0.1, 0.3, 0.2, 0.1, rate_std**2])
    found, spread = models.predict(np.tile(mean, (1, 2, 1)), np.tile(covariance, (1, 2, 1, 1)))
    samples = np.random.default_rng(3).multivariate_normal(mean, covariance, 200_000)
    place, velocity, rate = samples[:, :3], samples[:, 3:6], samples[:, 6]
    centre = place[:, :2] + np.stack([-velocity[:, 1], velocity[:, 0]], axis=1) / rate[:, None]
    cosine, sine = np.cos(rate * dt)[:, None], np.sin(rate * dt)[:, None]
    arm, aside = place[:, :2] - centre, velocity[:, :2]
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])
    moved = [
        centre + cosine * arm + sine * (arm @ quarter),
        place[:, 2:] + dt * velocity[:, 2:],
        cosine * aside + sine * (aside @ quarter),
        velocity[:, 2:],
        rate[:, None],
    ]
    ahead = np.concatenate(moved, axis=1)
    assert found[0, 1] == pytest.approx(ahead.mean(axis=0), abs=0.01)
    assert spread[0, 1] == pytest.approx(np.cov(ahead.T), abs=0.02)
    # The model that goes straight on forgets the rate.
    assert found[0, 0] == pytest.approx([3.0, 1.5, 3.25, 4.0, -1.0, 0.5, 0.0])
    assert spread[0, 0, 6] == pytest.approx([0.0] * 6 + [rate_std**2])


def test_of_the_largest_noise_the_velocity_jumps():
    dt, noise = 0.5, Models.of(0.5, np.array([1.0, 2.0]), 3, 0, jumping=True).noise
    jump, moment = np.random.default_rng(4).normal(size=200_000), np.random.default_rng(5).uniform(0.0, dt, 200_000)
    moved = np.cov([2.0 * dt * jump * (dt - moment), 2.0 * dt * jump])
    assert noise[1][::3, ::3] == pytest.approx(moved, rel=0.02)
    assert np.linalg.matrix_rank(noise[0]) == 3


@pytest.mark.slow
def test_on_a_circle_it_is_better_than_any_acceleration_noise():
    circle = ["target.motion=circle", "target.radius=5", "target.period=8"]
    scenario = load("tracking", ["steps=80", *circle]).scenario
    traces = simulate([scenario.changed(seed=1001 + more) for more in range(3)])
    known, seen = told(traces, 80)
    truth = np.stack([trace.truth for trace in traces])
    off = [
        np.sqrt(np.mean(np.sum((strong(one, seen)[0] - truth)[:, 40:, :3] ** 2, axis=2)))
        for one in (known, replace(known, turn_rate_std=None))
    ]
    assert off[0] < 0.7 * off[1]


def test_heavy_tails_leave_out_a_wrong_range():
    anchor, truth = 10.0 * RANDOM.normal(size=(6, 3)), np.array([1.0, 2.0, 3.0])
    ranges = np.linalg.norm(truth - anchor, axis=1)
    ranges[2] += 30.0
    start, wide = np.zeros((1, 1, 6)), np.diag([9.0] * 6)[None, None]
    gaussian = update(start, wide, heard(anchor, ranges), 6).mean[0, 0, :3]
    robust = update(start, wide, heard(anchor, ranges, heavy=4.0), 12).mean[0, 0, :3]
    assert np.linalg.norm(robust - truth) < 0.1
    assert np.linalg.norm(gaussian - truth) > 1.0


def errors(overrides, seeds=3, steps=60):
    scenario = load("tracking", [f"steps={steps}", *overrides]).scenario
    traces = simulate([scenario.changed(seed=1001 + more) for more in range(seeds)])
    states, covariances = strong(*told(traces, steps))
    truth = np.stack([trace.truth for trace in traces])
    error = (states - truth)[:, steps // 2 :]
    nees = np.einsum("rki,rki->rk", error, np.linalg.solve(covariances[:, steps // 2 :], error[..., None])[..., 0])
    return np.sqrt(np.sum(error[..., :3] ** 2, axis=2).mean(axis=1)), nees.mean()


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["filter.initial_position=[50,0,0]", "filter.initial_position_std=50"],
        ["filter.initial_position=[7,7,7]"],
        ["target.motion=circle", "target.period=8"],
        ["sensor.outlier_probability=0.4", "sensor.outlier_scale=30"],
        ['fault=[{kind="sensor-dropout",probability=1.0,from=2.0,until=4.5}]'],
    ],
)
def test_it_holds_where_the_twin_may_be_lost(overrides):
    found, _ = errors(overrides)
    assert (found < 0.5).all()


def test_its_covariance_says_how_far_it_is_off():
    _, nees = errors([], seeds=6)
    assert 4.0 < nees < 8.0


def test_it_is_told_which_ranges_are_wrong_and_no_others():
    clean = load("tracking", ["steps=50"]).scenario
    dirty = load("tracking", ["steps=50", "sensor.outlier_probability=0.2"]).scenario
    one, other = simulate([clean])[0], simulate([dirty])[0]
    flagged = wrong_ranges(other)
    assert flagged is not None
    assert not np.any(wrong_ranges(one))
    assert (np.abs(other.ranges - one.ranges) > 0.01).tolist() == flagged.tolist()


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        ([], [1.0 / 6.0, 0.25 / 6.0]),
        (["filter.initial_position=[1,2,3]"], [1.0, 0.25 / 6.0]),
        (["filter.initial_position=[[1,2,3],[1,2,4],[1,2,3],[1,2,3],[1,2,3],[1,2,3]]"], [1.0 / 6.0, 0.25 / 6.0]),
        (["filter.initial_velocity=[0,0,0]"], [1.0 / 6.0, 0.25]),
    ],
)
def test_what_agents_know_together_is_the_mean_of_independent_guesses(overrides, expected):
    plan = Plan(load("tracking", overrides).scenario)
    assert np.diagonal(known_together(plan)) == pytest.approx(np.repeat(expected, 3))


def test_a_batch_gives_each_run_what_it_gets_alone():
    scenario = load("tracking", ["steps=30"]).scenario
    traces = simulate([scenario.changed(seed=seed) for seed in (1, 2)])
    together = strong(*told(traces, 30))[0]
    alone = strong(*told(traces[1:], 30))[0]
    assert together[1] == pytest.approx(alone[0], abs=1e-6)


def test_without_a_range_it_predicts():
    known = Known(0.1, 0.1, (0.3,), np.inf, 20, None, np.ones((1, 6)), np.eye(6), None)
    nothing = Seen(np.zeros((1, 4, 5, 3)), np.full((1, 4, 5), np.nan), np.zeros((1, 4, 5)))
    states, _ = strong(known, nothing)
    assert states[0, -1] == pytest.approx([1.5, 1.5, 1.5, 1.0, 1.0, 1.0])


def test_noise_beyond_the_digits_of_a_float_ends_in_numbers():
    scenario = load(
        "paper", ["steps=30", "sensor.range_std=1e-9", "sensor.signal_speed=1.0", "agents.high=2.5"]
    ).scenario
    states, _ = strong(*told(simulate([scenario]), 30))
    assert np.isfinite(states).all()


def test_a_run_that_ended_early_is_told_its_wrong_ranges_too():
    scenario = load("tracking", ["steps=40", "sensor.outlier_probability=0.2"]).scenario
    whole = simulate([scenario])[0]
    parts = {name: getattr(whole, name)[:, :25] for name in ("ranges", "age", "positions")}
    early = replace(whole, time=whole.time[:25], truth=whole.truth[:25], **parts)
    flagged = wrong_ranges(whole)
    assert flagged is not None
    np.testing.assert_array_equal(wrong_ranges(early), flagged[:, :25])
    states, _ = strong(*told([early], 25))
    assert states.shape == (1, 25, 6)
