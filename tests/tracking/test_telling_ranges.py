"""Agents that tell each other their ranges are one centralised Kalman filter, where a sphere is nearly a plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tracking.centralised import (
    ACCELERATION,
    COUNT,
    DT,
    MOTION,
    PLACES,
    WIDE,
    ahead,
    expected,
    guesses_of,
    heard,
    kalman,
    mixture,
    same,
    settings_of,
    step_of,
    switching,
    weights_of,
    whole,
)
from zenoh_cbef.tracking.filters import Belief, make_filter, sharing_of
from zenoh_cbef.tracking.filters.models.told_ranges import ToldRanges
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours


@pytest.mark.parametrize(
    ("motion", "guesses", "bias", "std"),
    [
        (MOTION, (1, 1), 0.0, None),
        (MOTION, None, 0.0, np.array([0.1, 0.2, 0.3, 0.15])),
        (MOTION, (4, 2), 0.0, None),
        (MOTION, (1, 4), 0.4, None),
        (NearlyConstantVelocity(DT, 0.5, 2), (1, 1), 0.0, None),
        (ACCELERATION, (2, 4), 0.0, None),
        (ACCELERATION, (1, 1), 0.4, None),
    ],
)
def test_whatever_the_weights_all_agents_are_one_kalman_filter(motion, guesses, bias, std):
    random, axes = np.random.default_rng(1), motion.axes
    filter_ = make_filter("icf", settings_of(motion, bias, guesses=guesses))
    kept = [*range(axes), *range(3, 3 + axes)]
    wide = WIDE[kept][:, kept]
    belief = guesses_of(random, np.arange(2.0 * axes), wide)
    scale = np.repeat(np.array(guesses or (1, 1)) ** -0.5, axes)
    mean, covariance = whole(motion, belief.state.mean(axis=0), wide * np.outer(scale, scale), bias)
    if motion == ACCELERATION and not bias:  # of which the first belief may say something, too
        belief = guesses_of(random, np.arange(9.0), whole(motion, np.zeros(6), wide)[1], 0.0)
        mean = np.arange(9.0)
    truth = mean[: motion.size] + 0.3 * random.normal(size=motion.size)
    errors = bias * random.normal(size=COUNT)
    for number in range(4):
        truth = motion.transition @ truth
        new = heard(truth, random, [number], axes=axes, std=std, bias=errors)
        mean, covariance, _ = kalman(ahead(motion, mean, covariance), new, motion.size)
        belief = step_of(filter_, belief, new, weights_of(random) if number else None)
        same(belief, mean, covariance)
        if belief.bias:
            np.testing.assert_allclose(belief.bias.value, mean[-COUNT:], atol=2e-4)
            np.testing.assert_allclose(belief.bias.std, np.sqrt(np.diag(covariance)[-COUNT:]), atol=2e-4)
            assert (belief.bias.weight == 1.0).all()
        assert (belief.bias is None) == (bias == 0.0)


@pytest.mark.parametrize("more", [{}, {"bias": 0.4}, switching(MOTION, MOTION)])
def test_who_misses_messages_lacks_these_ranges_and_goes_on_from_its_own_estimate(more):
    random = np.random.default_rng(2)
    filter_, bias = make_filter("icf", settings_of(**more)), more.get("bias", 0.0)
    guess = guesses_of(random, np.arange(6.0), WIDE)
    weights = np.full((COUNT, COUNT), 1.0 / COUNT)
    weights[2], weights[3] = [0.0, 0.0, 1.0, 0.0], [0.0, 0.3, 0.4, 0.3]
    new = heard(np.arange(6.0), random)
    belief = step_of(filter_, guess, new, weights)
    alone = ahead(MOTION, guess.state[2], WIDE)
    same(belief, *alone, agents=slice(2, 3))
    prior = ahead(MOTION, *whole(MOTION, weights[3] @ guess.state, WIDE, bias))
    mean, covariance, _ = kalman(prior, replace(new, range=np.where([1, 0, 0, 0], np.nan, new.range)))
    same(belief, mean, covariance, agents=slice(3, 4))
    belief = step_of(filter_, belief, heard(np.zeros(6), random, range(COUNT)))
    same(belief, *ahead(MOTION, *alone), agents=slice(2, 3))
    same(belief, *ahead(MOTION, mean, covariance), agents=slice(3, 4))


@pytest.mark.parametrize("bias", [0.0, 0.4])
def test_a_belief_at_another_place_is_no_guess_and_what_is_known_of_biases_stays(bias):
    random = np.random.default_rng(3)
    filter_ = ToldRanges.of(settings_of(bias=bias, guesses=(4, 4)))
    errors = bias * random.normal(size=COUNT)
    belief = step_of(filter_, guesses_of(random, np.zeros(6), WIDE), heard(np.zeros(6), random, bias=errors))
    place = guesses_of(random, np.full(6, 3.0), 0.5 * WIDE, 0.0)
    there, fresh = filter_.moved(belief, place), filter_.resumed(place)
    prior = ahead(MOTION, *whole(MOTION, np.full(6, 3.0), 0.5 * WIDE, bias))
    new = heard(prior[0][:6], random, bias=errors)
    for one in (there, fresh):
        same(one, np.full(6, 3.0), 0.5 * WIDE)
    same(step_of(filter_, fresh, new), *kalman(prior, new)[:2])
    later = step_of(filter_, there, heard(np.zeros(6), random, range(COUNT)))
    same(later, *prior)
    if belief.bias:
        assert later.bias is not None
        assert np.abs(belief.bias.value).max() > 0.01
        np.testing.assert_allclose(later.bias.value, belief.bias.value, atol=1e-9)
        np.testing.assert_allclose(later.bias.std, belief.bias.std, atol=1e-9)


@pytest.mark.parametrize(
    ("motions", "bias"),
    [
        ((MOTION, ACCELERATION, NearlyConstantVelocity(DT, 4.0, 3)), 0.0),
        ((MOTION, NearlyConstantVelocity(DT, 4.0, 3)), 0.4),
    ],
    ids=["without biases", "with all biases"],
)
def test_several_motions_are_an_interacting_multiple_model_filter(motions, bias):
    random, leaving, count = np.random.default_rng(4), 0.1, len(motions)
    filter_ = make_filter("icf", settings_of(bias=bias, **switching(*motions, leaving=leaving)))
    belief, errors = guesses_of(random, np.arange(6.0), WIDE), bias * random.normal(size=COUNT)
    chance, truth = np.full(count, 1.0 / count), np.arange(6.0)
    parts = [whole(motion, belief.state.mean(axis=0), WIDE, bias) for motion in motions]
    other = leaving / (count - 1)
    chain = np.full((count, count), other) + (1.0 - leaving - other) * np.eye(count)
    for number in range(5):
        truth = MOTION.transition @ truth
        truth[3:] += 1.2 * random.normal(size=3)
        new = heard(truth, random, [number % 3], bias=errors)
        later, priors = chance @ chain, []
        for to, motion in enumerate(motions):
            # The acceleration begins anew in a target that moved without one.
            each = [one if type(motion) is type(motions[of]) else whole(motion, one[0][:6], one[1][:6, :6])
                    for of, one in enumerate(parts)]  # fmt: skip
            share = chance * chain[:, to] / later[to]
            mean = sum(one * part[0] for one, part in zip(share, each, strict=True))
            apart = [part[1] + np.outer(part[0] - mean, part[0] - mean) for part in each]
            spread = sum(one * part for one, part in zip(share, apart, strict=True))
            priors.append(ahead(motion, mean, spread))
        found = [kalman(prior, new, motion.size) for prior, motion in zip(priors, motions, strict=True)]
        chance = later * np.exp([one[2] - found[0][2] for one in found])
        chance, parts = chance / chance.sum(), [(mean, covariance) for mean, covariance, _ in found]
        said = filter_.update(belief, new).diagnostics
        belief = step_of(filter_, belief, new, weights_of(random) if number else None)
        np.testing.assert_allclose(said.maneuver, later[-1], atol=1e-4)
        np.testing.assert_allclose(belief.known_chance, np.broadcast_to(chance, (COUNT, count)), atol=1e-4)
        same(belief, *mixture(chance, parts))
        if bias:
            known = sum(one * part[0][6:] for one, part in zip(chance, parts, strict=True))
            np.testing.assert_allclose(belief.bias.value, known, atol=1e-4)
        if number:
            # What agents say of a range is said by the likeliest motion.
            best = int(later.argmax())
            off, _, variance = expected(priors[best], new, 3, motions[best].size)
            assert said.nis[3] == pytest.approx(off**2 / variance, rel=1e-3)


def test_agents_say_how_their_own_range_fits_and_whether_it_is_right():
    random = np.random.default_rng(5)
    filter_ = make_filter("icf", settings_of(outliers=(0.1, 5.0)))
    belief, prior = guesses_of(random, np.arange(6.0), WIDE, 0.0), ahead(MOTION, np.arange(6.0), WIDE)
    new = heard(prior[0], random, [0])
    new.range[2] += 30.0
    said = filter_.update(belief, new).diagnostics
    for agent in (1, 2, 3):
        off, _, variance = expected(prior, new, agent)
        assert said.innovation[agent] == pytest.approx(abs(off), rel=1e-3)
        assert said.nis[agent] == pytest.approx(off**2 / variance, rel=1e-3)
        fits = np.exp(-0.5 * off**2 / variance)
        right = 0.9 * fits / np.sqrt(2.0 * np.pi * variance)
        wrong = 0.1 / 5.0 * (np.exp(-off / 5.0) if off > 0.0 else fits)
        assert said.weight[agent] == pytest.approx(right / (right + wrong), abs=1e-3)
    assert np.isnan([said.innovation[0], said.nis[0], said.weight[0]]).all()
    assert said.nis_degrees.tolist() == [0, 1, 1, 1]
    assert np.isnan(said.maneuver).all()
    new.range[2] += 1e9
    assert filter_.update(belief, new).diagnostics.weight[2] < 1e-100


@pytest.mark.parametrize("models", [(), (MOTION, ACCELERATION)])
@pytest.mark.parametrize("off", [0.0, 3.3, 40.0])
def test_at_first_the_target_may_be_anywhere_with_one_chance_in_a_hundred(models, off):
    """Two priors of each motion, of which the ranges decide."""
    random = np.random.default_rng(6)
    elsewhere = np.array([[2.0, 3, 4, 0, 0, 0]]), np.diag([5.0, 5, 5, 2, 2, 2])[None] ** 2
    filter_ = make_filter("icf", settings_of(anywhere=elsewhere, **(switching(*models) if models else {})))
    belief = guesses_of(random, np.zeros(6), WIDE)
    new = heard(np.array([off, 0.0, 0.0, 0, 0, 0]), random)
    priors = (1.0, (belief.state.mean(axis=0), WIDE)), (0.01, (elsewhere[0][0], elsewhere[1][0]))
    found, share = [], []
    for motion in models or (MOTION,):
        for chance, prior in priors:
            found.append(kalman(ahead(motion, *whole(motion, *prior)), new, motion.size))
            share.append(chance * np.exp(found[-1][2] + 200.0))
    mean, covariance = mixture(np.array(share) / sum(share), found)
    belief = step_of(filter_, belief, new)
    np.testing.assert_allclose(belief.state, np.repeat(mean[None], COUNT, axis=0), atol=0.01)
    np.testing.assert_allclose(belief.known_covariance, np.repeat(covariance[None], COUNT, axis=0), atol=0.01)
    for number in range(4):
        new = heard(np.array([off, 0.0, 0.0, 0, 0, 0]), random, [number])
        belief = step_of(filter_, belief, new)
    assert np.abs(belief.state[:, :3] - [off, 0.0, 0.0]).max() < 0.5


@pytest.mark.parametrize(("count", "size"), [(1, 27), (2, 27), (4, 34)])
def test_a_payload_has_a_place_for_each_agent_and_room_for_a_fix(count, size):
    """One agent takes in its own range; of two, one that hears nothing of the other takes in none."""
    random, some = np.random.default_rng(7), slice(count)
    settings = settings_of(count=count)
    belief, new = guesses_of(random, np.arange(6.0), WIDE), heard(np.arange(6.0), random)
    belief = Belief(belief.state[some], belief.known_covariance[some])
    new = Measurement(new.position[some], new.range[some], new.age[some], *no_neighbours(count), agent=np.arange(count))
    filter_ = make_filter("icf", settings)
    update = filter_.update(belief, new)
    assert update.payload.shape[1] == sharing_of("icf", settings).payload_size == size
    found, prior = filter_.conclude(update.payload, update), ahead(MOTION, belief.state[0], WIDE)
    same(found, *(kalman(prior, new)[:2] if count == 1 else prior), agents=slice(1))


def test_runs_beside_each_other_are_as_alone():
    """Agents are counted through a batch of several runs."""
    random, filter_ = np.random.default_rng(8), make_filter("icf", settings_of())
    pairs = [(guesses_of(random, np.full(6, at), WIDE), heard(np.full(6, at), random, [1])) for at in (0.0, 2.0)]
    alone = [step_of(filter_, *pair) for pair in pairs]
    states = np.concatenate([guess.state for guess, _ in pairs])
    new = pairs[0][1]
    both = replace(
        new,
        position=np.tile(PLACES, (2, 1)),
        range=np.concatenate([one.range for _, one in pairs]),
        age=np.tile(new.age, 2),
        agent=np.arange(2 * COUNT),
    )
    update = filter_.update(Belief(states, np.tile(WIDE, (2 * COUNT, 1, 1))), both)
    found = filter_.conclude(np.kron(np.eye(2), np.full((COUNT, COUNT), 1.0 / COUNT)) @ update.payload, update)
    np.testing.assert_allclose(found.state, np.concatenate([one.state for one in alone]), atol=1e-9)


def test_agents_have_to_know_their_numbers():
    random = np.random.default_rng(9)
    new = replace(heard(np.zeros(6), random), agent=None)
    with pytest.raises(ValueError, match="have to know their numbers"):
        make_filter("icf", settings_of()).update(guesses_of(random, np.zeros(6), WIDE), new)
