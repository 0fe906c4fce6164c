"""Several motions at once: the network weighs them as a centralised filter does that was written another way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.unaided import centralised
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.central_models import CentralModels, centralized_models
from zenoh_cbef.tracking.filters import FilterSettings, make_filter, sharing_of
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.motion import MotionSettings, NearlyConstantVelocity, make_motion
from zenoh_cbef.tracking.payloads import InformationPayloads, SeveralPayloads
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours
from zenoh_cbef.tracking.reference import Ranges, each_step, stacked
from zenoh_cbef.tracking.switching import Switching, moments

DT, STD, AGENTS, STEPS, LEAVING = 0.2, 0.1, 6, 40, 0.08
CALM, WILD = NearlyConstantVelocity(DT, 0.1), NearlyConstantVelocity(DT, 20.0)
TURN = make_motion("turn", MotionSettings(DT, 0.1, turn_rate_std=0.5))
RANDOM = np.random.default_rng(5)
PLACES = RANDOM.uniform(-10.0, 10.0, (AGENTS, 3))


def path():
    """Straight on, a jump of the velocity, straight on."""
    speed = np.where(np.arange(STEPS)[:, None] < STEPS // 2, [1.0, 0.5, 0.2], [-2.0, 1.0, -0.5])
    return np.cumsum(DT * speed, axis=0)


TRUTH = path()
RANGES = np.linalg.norm(TRUTH[None] - PLACES[:, None], axis=2) + STD * RANDOM.normal(size=(AGENTS, STEPS))
RANGES[2, 7:12] = np.nan
BEGIN = np.array([*TRUTH[0], 0.9, 0.4, 0.3]), np.diag([0.25] * 3 + [0.04] * 3)


def by_the_book(motions):
    """Blom and Bar-Shalom's filter for linear motions, with the innovations' own covariance: states (K, 6), chances."""
    count = len(motions)
    chain = np.full((count, count), LEAVING / (count - 1)) + np.eye(count) * (1 - LEAVING - LEAVING / (count - 1))
    chance, means, spreads = np.full(count, 1 / count), [BEGIN[0]] * count, [BEGIN[1]] * count
    states, chances = [], []
    for k in range(STEPS):
        ahead = chain.T @ chance
        weights = chain * chance[:, None] / ahead
        mixed = [sum(weights[i, j] * means[i] for i in range(count)) for j in range(count)]
        mixed_spreads = [
            sum(weights[i, j] * (spreads[i] + np.outer(means[i] - mixed[j], means[i] - mixed[j])) for i in range(count))
            for j in range(count)
        ]
        likelihood = np.empty(count)
        for j, motion in enumerate(motions):
            x = motion.transition @ mixed[j]
            p = motion.transition @ mixed_spreads[j] @ motion.transition.T + motion.process_noise
            there = np.isfinite(RANGES[:, k])
            away = x[:3] - PLACES[there]
            distance = np.linalg.norm(away, axis=1)
            h = np.hstack([away / distance[:, None], np.zeros((there.sum(), 3))])
            s = h @ p @ h.T + STD**2 * np.eye(there.sum())
            z = RANGES[there, k] - distance
            gain = p @ h.T @ np.linalg.inv(s)
            means[j], spreads[j] = x + gain @ z, p - gain @ h @ p
            likelihood[j] = -0.5 * (z @ np.linalg.solve(s, z) + np.linalg.slogdet(s)[1])
        chance = ahead * np.exp(likelihood - likelihood.max())
        chance /= chance.sum()
        states.append(sum(chance[j] * means[j] for j in range(count)))
        chances.append(chance)
    return np.array(states), np.array(chances)


def settings(models, **more):
    return FilterSettings(
        CALM, Space(), STD, np.inf, AGENTS, models=models, leaving=(LEAVING,), middle=(3.0, -2.0, 1.0), **more
    )


def everyone(part):
    return np.repeat(part[None], AGENTS, axis=0)


def network(chosen, spoiled=()):
    """A network whose agents average exactly: states (K, 6) of the first agent, and chances (K, M)."""
    filter_, belief = make_filter("icf", chosen), Belief(*map(everyone, BEGIN))
    states, chances = [], []
    for k in range(STEPS):
        update = filter_.update(belief, Measurement(PLACES, RANGES[:, k], np.zeros(AGENTS), *no_neighbours(AGENTS)))
        mean = everyone(update.payload.mean(axis=0))
        if k in spoiled:
            mean = update.payload
        belief = filter_.conclude(mean, update)
        states.append(belief.state[0])
        chances.append(belief.known_chance[0])
    return np.array(states), np.array(chances)


def test_a_network_that_averages_exactly_is_the_filter_by_the_book():
    states, chances = network(settings((CALM, WILD)))
    expected, probabilities = by_the_book((CALM, WILD))
    np.testing.assert_allclose(states, expected, atol=1e-8)
    np.testing.assert_allclose(chances, probabilities, atol=1e-7)
    assert chances[STEPS // 2 - 1, 0] > 0.9
    assert chances[STEPS // 2 : STEPS // 2 + 2, 1].max() > 0.9


def test_ranges_that_are_counted_without_end_say_nothing_of_the_motion_either():
    filter_, belief = make_filter("icf", settings((CALM, WILD))), Belief(*map(everyone, BEGIN))

    def after(belief, ranges, often):
        told = Measurement(PLACES, ranges, np.zeros(AGENTS), *no_neighbours(AGENTS), overcounted=np.full(AGENTS, often))
        update = filter_.update(belief, told)
        return filter_.conclude(everyone(update.payload.mean(axis=0)), update)

    for k in range(3):  # until the motions predict different places
        belief = after(belief, RANGES[:, k], 1.0)
    found = [after(belief, *one).known_chance for one in ((RANGES[:, 3] + 3.0, 1e12), (np.full(AGENTS, np.nan), 1.0))]
    np.testing.assert_allclose(found[0], found[1], atol=1e-6)


def test_the_centralised_filter_is_the_filter_by_the_book():
    models = CentralModels(Switching((CALM, WILD), (LEAVING,)), Space(), np.inf)
    beliefs = centralized_models(
        Belief(BEGIN[0][None], BEGIN[1][None]),
        models,
        each_step(
            positions=np.repeat(PLACES[None, :, None], STEPS, axis=2),
            ranges=RANGES[None],
            age=np.zeros((1, AGENTS, STEPS)),
            range_std=STD,
        ),
    )
    states, covariances = stacked(Space(), beliefs)
    np.testing.assert_allclose(states[0], by_the_book((CALM, WILD))[0], atol=1e-8)
    assert covariances.shape == (1, STEPS, 6, 6)


def test_a_network_of_different_states_is_the_centralised_one():
    motions = (CALM, TURN, WILD)
    states, chances = network(settings(motions))
    models, belief = (
        CentralModels(Switching(motions, (LEAVING,)), Space(), np.inf),
        Belief(BEGIN[0][None], BEGIN[1][None]),
    )
    for k in range(STEPS):
        seen = Ranges(PLACES[None], RANGES[None, :, k], np.zeros((1, AGENTS)), np.full((1, AGENTS), STD))
        belief, _ = models.step(belief, seen)
        np.testing.assert_allclose(states[k], belief.state[0], atol=1e-8)
        np.testing.assert_allclose(chances[k], belief.known_chance[0], atol=1e-6)


def test_models_that_are_all_the_same_are_the_single_filter():
    several, _ = network(settings((CALM, CALM, CALM)))
    filter_, belief = make_filter("icf", settings(())), Belief(*map(everyone, BEGIN))
    for k in range(STEPS):
        update = filter_.update(belief, Measurement(PLACES, RANGES[:, k], np.zeros(AGENTS), *no_neighbours(AGENTS)))
        belief = filter_.conclude(everyone(update.payload.mean(axis=0)), update)
        np.testing.assert_allclose(several[k], belief.state[0], atol=1e-9)


def test_agents_of_different_noise_count_by_their_own():
    motions, noise = (CALM, TURN, WILD), STD * np.linspace(0.5, 3.0, AGENTS)
    filter_, mine = make_filter("icf", settings(motions)), Belief(*map(everyone, BEGIN))
    models, belief = (
        CentralModels(Switching(motions, (LEAVING,)), Space(), np.inf),
        Belief(BEGIN[0][None], BEGIN[1][None]),
    )
    for k in range(STEPS // 2 + 3):
        seen = Ranges(PLACES[None], RANGES[None, :, k], np.zeros((1, AGENTS)), noise[None])
        belief, _ = models.step(belief, seen)
        update = filter_.update(
            mine, Measurement(PLACES, RANGES[:, k], np.zeros(AGENTS), *no_neighbours(AGENTS), noise)
        )
        mine = filter_.conclude(everyone(update.payload.mean(axis=0)), update)
        np.testing.assert_allclose(mine.state[0], belief.state[0], atol=1e-8)
        np.testing.assert_allclose(mine.known_chance[0], belief.known_chance[0], atol=1e-6)


def test_an_agent_alone_is_the_centralised_filter_of_its_own_ranges():
    motions, alone = (CALM, WILD), replace(settings((CALM, WILD)), network_size=1)
    filter_, mine = make_filter("sicf", replace(alone, xi=1.5)), Belief(BEGIN[0][None], BEGIN[1][None])
    models, belief = CentralModels(Switching(motions, (LEAVING,)), Space(), 1.5), mine
    for k in range(STEPS // 3):  # One agent's geometry makes covariances longer and longer.
        seen = Ranges(PLACES[None, :1], RANGES[None, :1, k], np.zeros((1, 1)), np.full((1, 1), STD))
        belief, told = models.step(belief, seen)
        update = filter_.update(mine, Measurement(PLACES[:1], RANGES[:1, k], np.zeros(1), *no_neighbours(1)))
        mine = filter_.conclude(update.payload, update)
        np.testing.assert_allclose(mine.state, belief.state, atol=1e-7)
        np.testing.assert_allclose(mine.known_chance, belief.known_chance, atol=1e-6)
        np.testing.assert_allclose(update.diagnostics.innovation, told.innovation[:, 0], atol=1e-6)
        np.testing.assert_allclose(update.diagnostics.nis, told.nis[:, 0], rtol=1e-5)
    assert not sharing_of("sicf", alone).cooperates
    assert sharing_of("sicf", settings(motions)).cooperates


def test_an_agent_that_hears_no_neighbour_weighs_nothing():
    _, chances = network(settings((CALM, WILD)), spoiled=(STEPS // 2,))
    before, after = chances[STEPS // 2 - 1], chances[STEPS // 2]
    other = LEAVING * before[::-1] + (1 - LEAVING) * before
    np.testing.assert_allclose(after, other, atol=1e-12)


def test_a_mixture_has_the_moments_of_its_parts():
    parts = [(RANDOM.normal(size=(1, 2)), np.array([[[one, 0.3], [0.3, 2.0]]])) for one in (1.0, 4.0)]
    mean, spread = moments([np.array([0.3]), np.array([0.7])], parts)
    which = np.random.default_rng(1).random(400_000) < 0.3
    draws = [np.random.default_rng(2 + j).multivariate_normal(parts[j][0][0], parts[j][1][0], 400_000) for j in (0, 1)]
    drawn = np.where(which[:, None], *draws)
    np.testing.assert_allclose(mean[0], drawn.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(spread[0], np.cov(drawn.T), atol=0.05)


def test_a_liar_displaces_every_model_and_leaves_the_numbers_after_them():
    chosen = settings((CALM, TURN, WILD))
    filter_, belief = make_filter("icf", chosen), Belief(*map(everyone, BEGIN))
    update = filter_.update(belief, Measurement(PLACES, RANGES[:, 0], np.zeros(AGENTS), *no_neighbours(AGENTS)))
    assert update.payload.shape[1] == sharing_of("icf", chosen).payload_size
    payloads = SeveralPayloads(tuple(InformationPayloads(3, motion.size) for motion in chosen.models))
    mean = everyone(update.payload.mean(axis=0))
    moved = payloads.displaced(mean, everyone(np.array([5.0, -3.0, 2.0])))
    np.testing.assert_array_equal(moved[:, -3:], mean[:, -3:])
    honest, lied = filter_.conclude(mean, update), filter_.conclude(moved, update)
    for own, other in zip(honest.parts, lied.parts, strict=True):
        np.testing.assert_allclose(other.state[0, :3] - own.state[0, :3], [5.0, -3.0, 2.0], atol=1e-6)


@pytest.mark.slow
def test_a_circle_is_tracked_with_the_defaults_as_well_as_by_the_centralised_filter():
    circle = ("target.motion=circle", "target.radius=5", "target.period=8", "steps=150")
    traces = simulate([load("tracking", (*circle, f"seed={seed}")).scenario for seed in (1001, 1002)])
    ratios = []
    for trace, central in zip(traces, centralised(traces), strict=True):
        truth = trace.truth[75:, :3]
        error = np.sqrt(np.mean(np.sum((trace.estimates[:, 75:, :3] - truth) ** 2, axis=2)))
        ratios.append(error / np.sqrt(np.mean(np.sum((central[75:, :3] - truth) ** 2, axis=1))))
        assert error < 0.15
        assert np.isfinite(trace.diagnostics.maneuver[:, trace.plan.first_fix_steps :]).all()
    assert np.median(ratios) < 1.02


def test_at_sharp_corners_it_knows_how_unsure_it_is():
    corners = "target.waypoints=[[0,0,0],[80,0,0],[80,80,0],[-20,80,40]]"
    fast = ("target.motion=waypoints", "target.speed=30", corners, "agents.low=-100", "agents.high=100", "steps=80")
    nees = {}
    for agile in ("jump", "ncv"):
        (trace,) = simulate([load("tracking", (*fast, f"filter.agile={agile}", "seed=1001")).scenario])
        error, spread = (trace.estimates - trace.truth)[:, 24:], trace.covariances[:, 24:]
        nees[agile] = np.mean(error[..., None, :] @ np.linalg.solve(spread, error[..., None]))
    assert nees["jump"] < 6.0
    assert nees["ncv"] > 2.0 * nees["jump"]


@pytest.mark.parametrize("more", [{}, {"learns_noise": True}, {"distrusts": True}])
def test_what_stands_around_it_sees_what_is_said_of_the_likeliest_motion(more):
    filter_, belief = make_filter("icf", settings((CALM, WILD), **more)), Belief(*map(everyone, BEGIN))
    told = filter_.update(
        belief, Measurement(PLACES, RANGES[:, 0], np.zeros(AGENTS), *no_neighbours(AGENTS))
    ).diagnostics
    assert np.isfinite(told.nis).all()
    np.testing.assert_array_equal(told.maneuver, 0.5)
