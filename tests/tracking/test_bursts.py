"""An agent whose ranges are wrong in bursts expects the next one to be wrong, too; one that errs by chance does not."""

from __future__ import annotations

from math import log

import numpy as np
import pytest

from tests.tracking.resting import AGENTS, MOTION, PLACES, STD, measured
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import Heard, heard_in, simulate
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.filters.around.bursts import Bursts
from zenoh_cbef.tracking.filters.kinds.sicf import SaturatedInformation
from zenoh_cbef.tracking.outliers import Untold
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours

PLAIN = SaturatedInformation(MOTION, Space(), STD, AGENTS, 1.5, outliers=Untold.of(STD, 1.5, bursts=True))
BEGIN = Belief(np.zeros((AGENTS, 6)), np.tile(0.01 * np.eye(6), (AGENTS, 1, 1)))


def steps_of(errors, *, hear=True):
    """Of a network whose ranges are off by errors (K, n): each belief, what is measured, the update, the belief after.

    The target rests at the origin.
    """
    filter_, belief = Bursts(PLAIN, Space(), STD), BEGIN
    for seed, row in enumerate(errors):
        update = filter_.update(belief, measured(row, seed))
        mixed = np.tile(update.payload.mean(axis=0), (AGENTS, 1)) if hear else update.payload
        after = filter_.conclude(mixed, update)
        yield belief, measured(row, seed), update, after
        belief = after


def smooth(excess):
    way = min(max((excess - log(2.0)) / log(2.0), 0.0), 1.0)
    return 3.0 * way**2 - 2.0 * way**3


def suspicion(wrong):
    """How likely an agent takes its next range to be wrong, after those of which it knows how wrong they were."""
    rare = again = count = 0.0
    for was, now in zip([0.0, *wrong], wrong, strict=False):
        rare += (1.0 - was) * (now - rare) / 50.0
        again, count = 0.97**was * again + was * now, 0.97**was * count + was
    return lambda latest: (1.0 - latest) * max(rare, 0.02) + latest * (1.0 + again) / (2.0 + count)


def errors_of(agent, steps=40):
    errors = np.zeros((steps, AGENTS))
    errors[5:12, agent] = errors[20:28, agent] = 5.0
    return errors


def test_every_step_is_what_the_equations_say_of_each_agent():
    errors = errors_of(2)
    errors[[9, 24], 2] = errors[22, 3] = np.nan
    # Of ranges that are a little off none is surely wrong.
    errors[14:30, 4], errors[17:19, 4] = 0.9, np.nan
    usual, highest = log(3.0), 0.0
    sizes, before, averages = [usual] * AGENTS, [usual] * AGENTS, [usual] * AGENTS
    known: list[list[float]] = [[] for _ in range(AGENTS)]
    fresh = [False] * AGENTS
    for belief, measurement, update, after in steps_of(errors):
        numbers = [sizes[i] + 0.9 * (averages[i] - before[i]) for i in range(AGENTS)]
        for i in range(AGENTS):
            likely = min(suspicion(known[i])(smooth(sizes[i] - averages[i])), 0.98)
            highest = max(highest, likely)
            inner = belief.parts[0] if belief.parts else belief
            told = Measurement(
                PLACES[[i]],
                measurement.range[[i]],
                np.zeros(1),
                *no_neighbours(1),
                wrong=np.array([likely]),
            )
            alone = PLAIN.update(Belief(inner.state[[i]], inner.known_covariance[[i]]), told)
            np.testing.assert_allclose(update.payload[i, :-1], alone.payload[0], rtol=1e-9)
            assert update.payload[i, -1] == pytest.approx(numbers[i], rel=1e-9)
        average = sum(numbers) / AGENTS
        for i in range(AGENTS):
            if fresh[i]:
                known[i].append(smooth(sizes[i] - average))
            fresh[i] = bool(np.isfinite(measurement.range[i]))
            before[i], averages[i] = sizes[i], average
            if fresh[i]:
                off = abs(measurement.range[i] - np.linalg.norm(after.state[i, :3] - PLACES[i]))
                sizes[i] = log(max(off / STD, 3.0))
    assert highest > 0.8


def share_of(errors, agent, *, hear=True):
    """What the agent takes the next range for, after all of these steps and a wrong range."""
    *_, (_, _, _, belief) = steps_of(errors, hear=hear)
    rare, again, count = (belief.memory[place][agent] for place in (-3, -2, -1))
    return max(rare, 0.02), (1.0 + again) / (2.0 + count)


def test_an_agent_that_is_wrong_in_bursts_learns_so_and_one_that_is_wrong_by_chance_learns_that():
    chance = np.random.default_rng(5).random(300) < 0.4
    by_chance, bursts = np.zeros((300, AGENTS)), np.zeros((300, AGENTS))
    by_chance[chance, 2] = 5.0
    bursts[np.arange(300) % 60 < 20, 2] = 5.0
    after_right, after_wrong = share_of(by_chance, 2)
    assert after_right == pytest.approx(0.4, abs=0.15)
    assert after_wrong == pytest.approx(0.4, abs=0.15)
    after_right, after_wrong = share_of(bursts, 2)
    assert after_right < 0.1
    assert after_wrong > 0.85
    assert share_of(bursts, 1) == (0.02, 0.5)


def test_where_no_neighbour_is_heard_or_all_are_off_alike_no_agent_is_suspected():
    assert share_of(errors_of(2), 2, hear=False)[0] < 0.05
    apart = np.tile(np.where(np.arange(AGENTS) % 2, 8.0, -8.0), (30, 1))
    assert [share_of(apart, agent)[0] for agent in range(AGENTS)] == [0.02] * AGENTS


MANY = "agents.count=13", "steps=130"
SHARP = (
    *("target.motion=waypoints", "target.speed=30", "agents.low=[-100,-100,-100]", "agents.high=[100,100,100]"),
    "target.waypoints=[[-90,-90,-90],[90,90,90],[-90,90,-90],[90,-90,90],[-90,-90,-90]]",
)
CIRCLE = "target.motion=circle", "target.radius=5", "target.period=8"


def worst_after_a_corner(rules):
    """How far off agents of two runs are at most from 0.6 s after the corner on, m."""
    scenarios, heard = [], []
    for seed in (1005, 1012):
        scenarios.append(load("tracking", [*SHARP, *MANY, f"seed={seed}", f"filter.defaults={rules}"]).scenario)
        true = heard_in(Plan(scenarios[-1]), make_world(scenarios[-1]))
        ranges = true.ranges.copy()
        # The corner is at step 104: one burst begins before it, the other one with it.
        ranges[0, 100:125] += 10.0
        ranges[-1, 104:125] += 10.0
        heard.append(Heard(true.positions, ranges, true.age))
    traces = simulate(scenarios, heard=heard)
    return [np.linalg.norm((one.estimates - one.truth)[:, 110:, :3], axis=2).max() for one in traces]


@pytest.mark.slow
def test_a_sharp_corner_in_two_bursts_does_not_lose_the_target():
    assert min(worst_after_a_corner(18)) > 5.0
    assert max(worst_after_a_corner(19)) < 0.5


@pytest.mark.slow
def test_without_wrong_ranges_estimates_are_those_of_an_agent_that_learns_nothing():
    first, second = (
        simulate([load("tracking", [*CIRCLE, *MANY, f"filter.defaults={rules}"]).scenario], keep_payloads=True)[0]
        for rules in (18, 19)
    )
    assert first.payloads is not None
    assert second.payloads is not None
    assert second.payloads.shape[-1] == first.payloads.shape[-1] + 1
    np.testing.assert_allclose(first.estimates[:, 60:], second.estimates[:, 60:], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("keys", "wanted"),
    [
        (["agents.count=13"], True),
        (["timing.mode=realtime"], True),
        ([], False),
        (["agents.count=13", "filter.defaults=18"], False),
        (["agents.count=13", "filter.xi=2"], False),
        (["agents.count=13", "sensor.outlier_probability=0.1"], False),
    ],
)
def test_it_is_for_agents_that_average_several_motions_and_are_told_nothing(keys, wanted):
    assert Bursts.wanted(Plan(load("tracking", [*CIRCLE, *keys]).scenario).settings) is wanted
    assert not Bursts.wanted(Plan(load("tracking", keys).scenario).settings)
