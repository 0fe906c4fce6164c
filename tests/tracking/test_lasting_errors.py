"""Errors of ranges that last, against independent derivations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.filters.around.lasting_errors import LastingErrors, Receiver
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.kinds.sicf import SaturatedInformation
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours

STD, AGENTS, STEPS = 0.1, 8, 300


def lasting(rng, shape, correlation, std=STD):
    """Errors (..., K) of which successive ones are so correlated."""
    errors = rng.normal(0.0, std, shape)
    for k in range(1, shape[-1]):
        errors[..., k] = correlation * errors[..., k - 1] + np.sqrt(1.0 - correlation**2) * errors[..., k]
    return errors


def taught(residuals):
    """What receivers know after residuals (n, K)."""
    known = Receiver.first(len(residuals))
    one = np.ones(len(residuals))
    for residual in residuals.T:
        known = known.after(residual, one, 0.0 * one, one, np.isfinite(residual))
    return known


@pytest.mark.slow
@pytest.mark.parametrize("correlation", [0.0, 0.6, 0.9])
def test_the_signs_of_residuals_tell_how_alike_they_are_in_spite_of_outliers(correlation):
    rng = np.random.default_rng(1)
    residuals = lasting(rng, (2000, 600), correlation)
    clean = np.mean(taught(residuals).agreed / taught(residuals).pairs)
    # Van Vleck: the mean product of the signs of two Gaussian numbers.
    assert clean == pytest.approx(2.0 / np.pi * np.arcsin(correlation), abs=0.02)
    spoilt = np.where(rng.random(residuals.shape) < 0.05, 50.0, residuals)
    assert np.mean(taught(spoilt).alike) == pytest.approx(np.mean(taught(residuals).alike), abs=0.12)


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.8])
def test_what_the_signs_share_tells_the_correlation(correlation):
    sums = np.array([1.0, -1.0]) * 40.0 * 2.0 / np.pi * np.arcsin(correlation)
    known = replace(Receiver.first(2), agreed=sums, pairs=np.full(2, 40.0))
    np.testing.assert_allclose(known.alike, [correlation, 0.0], atol=1e-12)


def test_errors_are_taken_for_alike_until_many_are_known():
    rng = np.random.default_rng(8)
    assert Receiver.first(1).surely == 0.98
    few, many = (taught(lasting(rng, (200, count), 0.0)) for count in (20, 300))
    assert np.median(few.surely - few.alike) > 0.3
    np.testing.assert_allclose(many.surely, many.alike, atol=0.03)


def test_a_range_that_was_not_measured_teaches_nothing():
    known = taught(lasting(np.random.default_rng(2), (3, 50), 0.8))
    nothing, one = np.full(3, np.nan), np.ones(3)
    after = known.after(nothing, one, 0.0 * one, 0.5 * one, np.isfinite(nothing))
    assert (after.left == 0.5 * known.left).all()
    kept = {**vars(known), "left": after.left, "large": 0.0 * one, "steps": known.steps + 1.0}
    for name, values in vars(after).items():
        np.testing.assert_array_equal(values, kept[name])


def test_the_factor_is_that_of_an_exponential_average_of_lasting_errors():
    correlation, kept = 0.8, 0.7
    weights = (1.0 - kept) * kept ** np.arange(200)
    apart = np.abs(np.subtract.outer(np.arange(200), np.arange(200)))
    exact = weights @ correlation**apart @ weights / (weights @ weights)
    known = replace(Receiver.first(1), agreed=np.array([2.0 / np.pi * np.arcsin(correlation)]), pairs=np.ones(1))
    known = replace(known, left=np.array([kept]))
    asked = []

    class Inner(SaturatedInformation):
        def update(self, belief, measurement):
            del belief
            asked.append(measurement.lasting[0])
            raise StopIteration

    belief = Belief(np.zeros((1, 6)), np.eye(6)[None], memory=tuple(vars(known).values()))
    for claims in (False, True):
        inner = Inner(MOTION, Space(), STD, 1)
        filter_ = LastingErrors(inner, MOTION, Space(), STD, learns=False, fix=0, claims=claims)
        with pytest.raises(StopIteration):
            filter_.update(belief, heard(np.ones((1, 3)), np.ones(1)))
    assert asked == [pytest.approx(exact, rel=1e-9), 1.0]


MOTION = NearlyConstantVelocity(0.1, 0.5)


def heard(position, ranges):
    count = len(position)
    return Measurement(position, ranges, np.zeros(count), *no_neighbours(count))


@pytest.mark.parametrize("claims", [False, True])
def test_a_range_brings_its_error_into_the_estimate_as_far_as_that_follows_it(claims):
    """By the gain K: K sigma^2, of a range that is taken for F times as noisy, unless errors only widen claims."""
    known = replace(Receiver.first(1), agreed=np.array([2.0 / np.pi * np.arcsin(0.8)]), pairs=np.ones(1))
    inner = SaturatedInformation(MOTION, Space(), STD, 1)
    filter_ = LastingErrors(inner, MOTION, Space(), STD, learns=False, fix=0, claims=claims)
    belief = Belief(np.zeros((1, 6)), 0.01 * np.eye(6)[None], memory=tuple(vars(known).values()))
    update = filter_.update(belief, heard(np.array([[1e4, 0.0, 0.0]]), np.full(1, 1e4)))
    after = Receiver(*filter_.conclude(update.payload, update).memory)
    spread = MOTION.predict_covariance(0.01 * np.eye(6)[None])[0, 0, 0]
    factor = 1.0 if claims else 1.8 / 0.2
    assert after.taken[0] == pytest.approx(STD**2 * spread / (spread + factor * STD**2), rel=1e-6)
    silent = filter_.update(filter_.conclude(update.payload, update), heard(np.ones((1, 3)), np.array([np.nan])))
    assert Receiver(*filter_.conclude(silent.payload, silent).memory).taken[0] == after.taken[0]


def tracked(correlation, *, wrapped=True, learns=False, begin=STD, seed=3, claims=False, weighs=False):
    """Mean NEES over its ideal in the second half of a run, sigma in the end, and all states; the average is exact."""
    rng = np.random.default_rng(seed)
    agents = rng.uniform(-10.0, 10.0, (AGENTS, 3))
    inner = SaturatedInformation(MOTION, Space(), begin, AGENTS, 3.0)
    outer = LastingErrors(inner, MOTION, Space(), begin, learns=learns, fix=0, claims=claims, weighs=weighs)
    filter_ = outer if wrapped else inner
    truth, errors = np.zeros(6), lasting(rng, (AGENTS, STEPS), correlation)
    belief = Belief(np.zeros((AGENTS, 6)), np.repeat(0.1 * np.eye(6)[None], AGENTS, axis=0))
    nees, states = [], []
    for k in range(STEPS):
        truth = MOTION.transition @ truth
        truth[3:] += 0.5 * 0.1 * rng.normal(size=3)
        update = filter_.update(belief, heard(agents, np.linalg.norm(agents - truth[:3], axis=1) + errors[:, k]))
        belief = filter_.conclude(np.repeat(update.payload.mean(axis=0)[None], AGENTS, axis=0), update)
        states.append(belief.state)
        error = belief.state[0, :3] - truth[:3]
        nees.append(error @ np.linalg.solve(belief.known_covariance[0, :3, :3], error) / 3.0)
    known = Receiver(*belief.memory) if wrapped else Receiver.first(1)
    return np.mean(nees[STEPS // 2 :]), np.median(begin * np.exp(known.scale)), np.array(states)


@pytest.mark.slow
def test_a_network_with_lasting_errors_knows_how_far_it_may_be_off():
    seeds = (3, 4)
    sure = np.mean([tracked(0.9, wrapped=False, seed=seed)[0] for seed in seeds])
    honest = np.mean([tracked(0.9, seed=seed)[0] for seed in seeds])
    assert sure > 2.5
    assert 1.0 / 1.5 < honest < 1.8 < sure
    assert np.mean([tracked(0.0, seed=seed)[0] for seed in seeds]) == pytest.approx(1.0, abs=0.3)


@pytest.mark.slow
def test_by_todays_rules_it_knows_that_too_and_weighs_ranges_as_if_errors_did_not_last():
    seeds = (3, 4)
    plain, wide = ([tracked(0.9, wrapped=wrapped, claims=True, seed=one) for one in seeds] for wrapped in (False, True))
    for one, other in zip(plain, wide, strict=True):
        np.testing.assert_array_equal(one[2], other[2])
    assert 1.0 / 1.5 < np.mean([each[0] for each in wide]) < 1.8 < np.mean([each[0] for each in plain])
    assert np.mean([tracked(0.0, claims=True, seed=one)[0] for one in seeds]) == pytest.approx(1.0, abs=0.3)


@pytest.mark.slow
def test_a_sigma_that_is_told_too_small_shows_in_what_is_claimed_also_where_errors_last():
    def nees(begin, *, weighs):
        return np.mean([tracked(0.9, begin=begin, claims=True, weighs=weighs, seed=seed)[0] for seed in (3, 4, 5)])

    assert 1.0 / 1.5 < nees(STD, weighs=True) < 1.5
    assert nees(0.5 * STD, weighs=True) < 1.5
    assert nees(0.5 * STD, weighs=False) > 3.0


def test_errors_that_never_change_and_others_beside_them_count_for_as_long_as_the_estimate_keeps_them():
    rng, kept, share = np.random.default_rng(4), 0.8, 0.5
    residuals = np.sqrt(share) * rng.normal(size=(400, 1)) + np.sqrt(1.0 - share) * rng.normal(size=(400, 250))
    known, one = Receiver.first(len(residuals)), np.ones(len(residuals))
    for residual in residuals.T:
        known = known.after(residual, one, 0.0 * one, kept * one, one > 0.0, weighs=True)
    weights = (1.0 - kept) * kept ** np.arange(100)
    exact = weights @ (share + (1.0 - share) * np.eye(100)) @ weights / (weights @ weights)
    assert np.mean(known.agreed / known.pairs) == pytest.approx(2.0 / np.pi * np.arcsin(share), abs=0.03)
    sure = replace(known, agreed=2.0 / np.pi * np.arcsin(share) * known.pairs)
    assert sure.factor(weighs=True) == pytest.approx(exact, rel=1e-6)
    assert sure.factor(weighs=False).max() < 0.5 * exact


@pytest.mark.parametrize("correlation", [0.0, 0.8])
@pytest.mark.parametrize("begin", [0.5 * STD, 2.0 * STD])
def test_sigma_is_learned_from_half_and_from_twice_of_it_also_where_errors_last(correlation, begin):
    assert tracked(correlation, learns=True, begin=begin)[1] == pytest.approx(STD, rel=0.25)


def test_errors_may_last_where_ranges_are_recorded_and_claiming_or_learning_costs_one_number():
    def plan(target="dataset", **more):
        return Plan(parse({"target": {"motion": target, "path": "set"}, "agents": PLACES, "filter": more}, "test"))

    assert plan().settings.lasting
    assert not plan(defaults=3).settings.lasting
    assert not plan(kind="kcf").settings.lasting
    for emulated in ([], ["sensor.real=true", "timing.mode=realtime"]):
        assert not Plan(load("tracking", emulated).scenario).settings.lasting
    old = plan(defaults=5).sharing.payload_size
    assert plan(range_std="auto", defaults=5).sharing.payload_size == old + 1
    new, before = (plan(bias="none", planar_height=0.0, defaults=rules) for rules in (12, 11))
    assert new.sharing.payload_size == before.sharing.payload_size + 1
    assert new.settings.recorded
    assert not before.settings.recorded
    assert plan(range_std="auto").settings.doubts_noise
    assert not plan(range_std="auto").settings.learns_noise
    assert plan(range_std="auto", defaults=11).settings.learns_noise


PLACES = {"positions": [[0, 0, 0], [9, 0, 0], [0, 9, 0]]}


@pytest.mark.parametrize("chosen", [{"range_std": one, "planar_height": 0.0} for one in ("auto", 0.1)])
def test_messages_of_a_first_fix_are_as_long_as_those_after_it(chosen):
    """The simulator would not see that they are not, the agents' codec would."""
    chosen = Plan(parse({"target": {"motion": "dataset", "path": "set"}, "agents": PLACES, "filter": chosen}, "test"))
    belief = chosen.initial_belief
    for step in range(chosen.first_fix_steps + 2):
        ranges = np.linalg.norm(np.array(PLACES["positions"]) - [2.0, 3.0, 0.0], axis=1)
        measured = heard(np.array(PLACES["positions"], float), ranges)
        update = chosen.filter.update(belief, replace(measured, step=step, agent=np.arange(3)))
        assert update.payload.shape[1] == chosen.sharing.payload_size
        belief = chosen.filter.conclude(np.repeat(update.payload.mean(axis=0)[None], 3, axis=0), update)
