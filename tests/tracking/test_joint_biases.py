"""Agents that estimate all biases together are a centralised Kalman filter of target and biases."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.filters import Belief, FilterSettings, make_filter
from zenoh_cbef.tracking.filters.around.recovering import widened
from zenoh_cbef.tracking.filters.base import Tied
from zenoh_cbef.tracking.filters.finding.moved import moved
from zenoh_cbef.tracking.joint import _Joint
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours

COUNT, STD, BETA = 4, 0.1, 0.5
MOTION = NearlyConstantVelocity(0.5, 0.5, 3)
SETTINGS = FilterSettings(
    MOTION, Space(), STD, np.inf, COUNT, bias="estimate", own_bias_std=BETA, told_biases=True, joint_biases=True
)
FILTER = make_filter("icf", SETTINGS)


def begun(random):
    """One fix of all agents, and what each knows of its own bias given that."""
    root = random.normal(size=(6, 6))
    state, covariance = random.normal(size=(1, 6)), (root @ root.T / 6.0 + np.eye(6))[None]
    tied = Tied(random.normal(size=COUNT), 0.3 * random.normal(size=(COUNT, 6)), random.uniform(0.05, 0.2, COUNT))
    return Belief(np.repeat(state, COUNT, axis=0), np.repeat(covariance, COUNT, axis=0), tied=tied)


def heard(random, agents=slice(None)):
    """Ranges of a step, of which the second is missing."""
    places, ranges = random.normal(scale=6.0, size=(COUNT, 3)), random.uniform(4.0, 9.0, COUNT)
    ranges[1] = np.nan
    number = np.arange(COUNT)[agents]
    return Measurement(
        places[agents], ranges[agents], np.full(len(number), 0.05), *no_neighbours(len(number)), agent=number
    )


def averaged(belief, measurement, chosen=FILTER):
    """What agents believe that learn the exact average."""
    update = chosen.update(belief, measurement)
    return chosen.conclude(np.repeat(update.payload.mean(axis=0)[None], COUNT, axis=0), update)


def kalman(mean, covariance, measurement, motion):
    """A step of the centralised filter of (p, v, d_1 ... d_n), in covariance form."""
    step = np.eye(6 + COUNT)
    step[:6, :6] = motion.transition
    mean, covariance = step @ mean, step @ covariance @ step.T
    covariance[:6, :6] += motion.process_noise
    there = [agent for agent in range(COUNT) if np.isfinite(measurement.range[agent])]
    rows, rest = np.zeros((len(there), 6 + COUNT)), np.zeros(len(there))
    for place, agent in enumerate(there):
        age = measurement.age[agent]
        offset = mean[:3] - age * mean[3:6] - measurement.position[agent]
        distance = np.linalg.norm(offset)
        rows[place, :3], rows[place, 3:6] = offset / distance, -age * offset / distance
        rows[place, 6 + agent] = 1.0
        rest[place] = measurement.range[agent] - distance - mean[6 + agent]
    gain = covariance @ rows.T @ np.linalg.inv(rows @ covariance @ rows.T + STD**2 * np.eye(len(there)))
    return mean + gain @ rest, covariance - gain @ rows @ covariance


@pytest.mark.parametrize(("known", "q", "common"), [(False, 0.5, 0.0), (True, 1e-5, 0.0), (False, 0.5, 0.7)])
def test_with_an_exact_average_it_is_the_centralised_filter_of_target_and_all_biases(known, q, common):
    """Where biases are known by a fix, what moves the target in the first step moves what they all are given it."""
    random, motion = np.random.default_rng(3), NearlyConstantVelocity(0.5, q, 3)
    chosen = make_filter("icf", replace(SETTINGS, motion=motion, common_bias_std=common))
    belief = begun(random)
    offset, slope, given = vars(belief.tied).values()
    if not known:
        belief, offset, slope = replace(belief, tied=None), np.zeros(COUNT), np.zeros((COUNT, 6))
        given = np.full(COUNT, BETA**2)
    first = belief.known_covariance[0]
    mean, cross = np.concatenate([belief.state[0], offset + slope @ belief.state[0]]), slope @ first
    covariance = np.block([[first, cross.T], [cross, cross @ slope.T + np.diag(given) + common**2]])
    for _ in range(4):
        measurement = heard(random)
        belief = averaged(belief, measurement, chosen)
        mean, covariance = kalman(mean, covariance, measurement, motion)
        np.testing.assert_allclose(belief.memory[0][0], mean, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(belief.memory[1][0], covariance, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(belief.state[0], mean[:6], rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(belief.bias.value, mean[6:], rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(belief.bias.std, np.sqrt(np.diag(covariance)[6:]), rtol=1e-5)


def test_an_agent_is_a_batch_of_one_and_alone_it_goes_on_by_prediction():
    random = np.random.default_rng(5)
    belief = averaged(begun(random), heard(random))
    for agent in range(COUNT):
        one = slice(agent, agent + 1)
        mine = Belief(belief.state[one], belief.covariance[one], memory=tuple(each[one] for each in belief.memory))
        whole = FILTER.update(belief, heard(np.random.default_rng(6)))
        alone = FILTER.update(mine, heard(np.random.default_rng(6), one))
        np.testing.assert_array_equal(alone.payload, whole.payload[one])
        kept = FILTER.conclude(alone.payload, alone)
        np.testing.assert_array_equal(kept.state, MOTION.predict_state(mine.state))


def test_a_move_and_a_recovery_leave_the_biases_alone():
    random = np.random.default_rng(8)
    belief = averaged(begun(random), heard(random))
    place = Belief(belief.state + 9.0, 4.0 * belief.known_covariance)
    there, wide = moved(FILTER, belief, place), widened(FILTER, belief, np.full(COUNT, 4.0))
    for after in (there, wide):
        np.testing.assert_array_equal(after.memory[0][:, 6:], belief.memory[0][:, 6:])
        np.testing.assert_array_equal(after.memory[1][:, 6:, 6:], belief.memory[1][:, 6:, 6:])
        np.testing.assert_allclose(after.memory[1][:, :6, :6], after.known_covariance)
    np.testing.assert_array_equal(there.memory[0][:, :6], place.state)


def test_few_agents_of_whose_biases_the_scenario_tells_estimate_them_together():
    for more, together in (
        ((), True),
        (("agents.count=12",), True),
        (("agents.count=13",), False),
        (("sensor.bias=0.2",), True),
        (("sensor.bias=0.2", "filter.defaults=11"), False),
        (('fault=[{kind="sensor-dropout",probability=0.5}]',), True),
        (('fault=[{kind="sensor-bias",bias=3.0,agents=[1]}]',), True),
        (('fault=[{kind="sensor-bias",bias=3.0,agents=[1]}]', "filter.defaults=15"), False),
        (("filter.bias_common_std=0.1",), False),
        (("filter.defaults=8",), False),
        (("filter.bias=none",), False),
        (("filter.kind=ci",), False),
        (("consensus.rounds=0",), False),
    ):
        plan = Plan(load("tracking", ["sensor.bias_std=0.5", *more]).scenario)
        assert plan.settings.joint_biases is together
        if together:
            size = 6 + plan.scenario.count
            assert plan.sharing.blocks == (size,)
    assert not Plan(load("tracking").scenario).settings.joint_biases


def test_so_do_few_agents_with_recorded_ranges():
    def sizes(count, **more):
        places = {"positions": [[float(place), float(place % 3), 0.0] for place in range(count)]}
        target = {"motion": "dataset", "path": "set"}
        return Plan(parse({"target": target, "agents": places, "filter": more}, "test")).sharing.blocks

    assert sizes(4) == (6, 10, 11)
    assert sizes(4, defaults=13) == (6, 10)
    assert sizes(13) == sizes(4, defaults=11) == (6, 7)
    assert sizes(4, bias="estimate") == (10, 11)


def test_what_a_first_fix_tells_of_biases_is_carried_over_with_its_correlations():
    """Of x ~ N(m, P) and d_i = a_i + b_i^T x + e_i: the mean and covariance of (x, c, d)."""
    random = np.random.default_rng(4)
    one = begun(random)
    offset, slope, given = vars(one.tied).values()
    settings = replace(SETTINGS, common_bias_std=0.7)
    filter_ = _Joint(settings, np.inf, Belief(one.state[:1], one.known_covariance[:1]), COUNT)
    filter_.begin(Belief(one.state[:1], one.known_covariance[:1]), one.tied)
    found, covariance = filter_._biased, one.known_covariance[0]  # noqa: SLF001
    np.testing.assert_allclose(found.state[0], [*one.state[0], 0.0, *(offset + slope @ one.state[0])])
    expected = np.zeros((7 + COUNT, 7 + COUNT))
    expected[:6, :6], expected[6, 6] = covariance, 0.7**2
    expected[7:, :6], expected[:6, 7:] = slope @ covariance, covariance @ slope.T
    expected[7:, 7:] = slope @ covariance @ slope.T + np.diag(given)
    np.testing.assert_allclose(found.known_covariance[0], expected, atol=1e-12)


def test_an_agent_that_does_not_hear_of_all_in_its_first_step_begins_with_what_it_knew():
    random = np.random.default_rng(3)
    belief, measurement = begun(random), heard(random)
    update = FILTER.update(belief, measurement)
    halves = np.repeat(update.payload.reshape(2, 2, -1).mean(axis=1), 2, axis=0)
    found = FILTER.conclude(halves, update)
    state, covariance, _ = found.memory
    expected, before, *_ = update.kept
    np.testing.assert_allclose(state, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(covariance, before, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(covariance[:, 8, 8], [BETA**2, BETA**2, before[2, 8, 8], BETA**2])
