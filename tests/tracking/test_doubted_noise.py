"""A given range noise that is wrong by a factor of two, found out by a network."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.unaided import errors
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters.around.doubted_noise import DoubtedNoise
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.kinds.sicf import SaturatedInformation
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours

TRUE, AGENTS, STEPS = 0.1, 8, 200
MOTION = NearlyConstantVelocity(0.1, 0.5)


def heard(position, ranges):
    count = len(position)
    return Measurement(position, ranges, np.zeros(count), *no_neighbours(count))


def tracked(given, *, doubted, followed=None, counts=True, steps=STEPS):
    """Position RMSE (m) and NEES over its ideal in the second half of a run, and all estimates; exact averages."""
    rng = np.random.default_rng(3)
    agents = rng.uniform(-10.0, 10.0, (AGENTS, 3))
    plain = SaturatedInformation(MOTION, Space(), given, AGENTS, 2.0, 2)
    chosen = DoubtedNoise(plain, given, AGENTS, fix=5, counts=counts) if doubted else plain
    truth, belief = np.zeros(6), Belief(np.zeros((AGENTS, 6)), np.repeat(0.1 * np.eye(6)[None], AGENTS, axis=0))
    errors, nees, states = [], [], []
    for _ in range(steps):
        truth = MOTION.transition @ truth
        truth[3:] += 0.5 * 0.1 * rng.normal(size=3)
        told = heard(agents, np.linalg.norm(agents - truth[:3], axis=1) + rng.normal(0.0, TRUE, AGENTS))
        if followed is not None:
            told = replace(told, followed=np.full(AGENTS, followed))
        update = chosen.update(belief, told)
        belief = chosen.conclude(np.repeat(update.payload.mean(axis=0)[None], AGENTS, axis=0), update)
        off = belief.state[0, :3] - truth[:3]
        errors.append(off @ off)
        nees.append(off @ np.linalg.solve(belief.known_covariance[0, :3, :3], off) / 3.0)
        states.append(belief.state)
    return np.sqrt(np.mean(errors[steps // 2 :])), np.mean(nees[steps // 2 :]), np.array(states)


def test_a_noise_that_is_right_is_left_as_it_is_bit_for_bit():
    np.testing.assert_array_equal(tracked(TRUE, doubted=True)[2], tracked(TRUE, doubted=False)[2])


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_noise_that_is_half_or_twice_of_the_true_one_costs_little_and_the_network_knows_its_error(factor):
    known, doubted, believed = (
        tracked(given, doubted=doubts)
        for given, doubts in ((TRUE, False), (factor * TRUE, True), (factor * TRUE, False))
    )
    assert doubted[0] < 1.03 * known[0]
    assert abs(np.log(doubted[1])) < 0.35 < abs(np.log(believed[1]))


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_network_that_counts_its_ranges_finds_out_within_a_hundred_of_them(factor):
    soon, late = (tracked(factor * TRUE, doubted=True, counts=counts, steps=20)[1] for counts in (True, False))
    assert abs(np.log(soon)) < 0.7 * abs(np.log(late))


def test_small_innovations_of_an_estimate_that_follows_its_errors_are_no_reason_to_trust_ranges_more():
    believed = tracked(2.0 * TRUE, doubted=False)
    followed = tracked(2.0 * TRUE, doubted=True, followed=0.75 * (2.0 * TRUE) ** 2)
    np.testing.assert_array_equal(followed[2], believed[2])


def test_noise_is_doubted_where_ranges_are_recorded_and_it_is_given():
    def plan(target="dataset", **more):
        places = {"positions": [[0, 0, 0], [9, 0, 0], [0, 9, 0]]}
        return Plan(parse({"target": {"motion": target, "path": "set"}, "agents": places, "filter": more}, "test"))

    assert plan().settings.doubts_noise
    by_rules = {rules: plan(defaults=rules).sharing.payload_size for rules in (5, 11, 12, 13)}
    assert by_rules[11] == by_rules[5] + 2
    assert by_rules[13] == by_rules[12] + 1
    assert plan(range_std="auto").settings.doubts_noise
    for kept in ({"defaults": 5}, {"range_std": "auto", "defaults": 11}, {"kind": "kcf"}):
        assert not plan(**kept).settings.doubts_noise
    assert emulated("filter.range_std=0.2")
    for alike in (
        (),
        ("sensor.real=true", "timing.mode=realtime", "filter.range_std=0.2"),
        *(("filter.range_std=0.2", more) for more in ("filter.defaults=6", "filter.motion=decay", "filter.kind=icf")),
    ):
        assert not emulated(*alike)


@pytest.mark.parametrize("other", [("target.motion=circle",), ("agents.count=3",)])
def test_it_is_doubted_with_several_motions_and_with_squared_ranges(other):
    assert emulated("filter.range_std=0.2", *other)
    assert not emulated("filter.range_std=0.2", "filter.defaults=14", *other)
    assert not emulated("filter.range_std=0.2", "filter.motion=ncv", "target.motion=circle")


def emulated(*keys):
    return Plan(load("tracking", keys).scenario).settings.doubts_noise


@pytest.mark.slow
@pytest.mark.parametrize("other", ["target.motion=circle", "agents.count=3"])
def test_a_noise_told_half_as_large_makes_no_such_network_too_sure(other):
    def nees(rules):
        keys = [f"filter.defaults={rules}", "filter.range_std=0.05", "target.radius=5", "seed=1001", "steps=100", other]
        (run,) = errors(simulate([load("tracking", keys).scenario]))
        return np.nanmean(run.nees[:, 50:]) / 6.0

    now, before = nees(15), nees(14)
    assert now < 1.3
    assert before > 1.5


@pytest.mark.slow
@pytest.mark.parametrize("told", [0.05, 0.2])
def test_a_network_of_emulated_receivers_finds_out_that_their_noise_was_told_wrong(told):
    def nees(rules):
        runs = load("tracking", [f"filter.range_std={told}", f"filter.defaults={rules}"]).scenario
        found = errors(simulate([runs.changed(seed=3001 + seed) for seed in range(3)]))
        return np.mean([np.nanmean(run.nees[:, run.first :]) / 6.0 for run in found])

    assert abs(np.log(nees(7))) < 0.3 < abs(np.log(nees(6)))
