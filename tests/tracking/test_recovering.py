"""A network in which most innovations are implausible makes room for them; one with a few outliers does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.filters.around.recovering import Recovering, widened
from zenoh_cbef.tracking.filters.around.returning import Returning
from zenoh_cbef.tracking.filters.models.imm import InteractingModels
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours


def within(outer):
    """The filter that the outermost one stands around: what an agent's range counts after it was alone."""
    assert isinstance(outer, Returning)
    return outer.filter


SATURATES = "filter.saturation=bounded"
"""No agent weighs ranges by how likely they are right, and learns that."""


def surprised(count):
    """A step of six agents of which `count` have a range 10 m too long, and one has none."""
    made = within(Plan(parse({"filter": {"recovery": True, "start": "given", "status": False}}, "test")).filter)
    random = np.random.default_rng(1)
    positions = random.uniform(-10.0, 10.0, (6, 3))
    ranges = np.linalg.norm(positions, axis=1)
    ranges[:count] += 10.0
    ranges[5] = np.nan
    belief = Belief(np.zeros((6, 6)), np.tile(0.01 * np.eye(6), (6, 1, 1)))
    return made, made.update(belief, Measurement(positions, ranges, np.zeros(6), *no_neighbours(6)))


@pytest.mark.parametrize(("count", "widened"), [(0, False), (2, False), (3, True), (5, True)])
def test_covariances_double_in_deviation_where_most_of_those_who_measured_are_surprised(count, widened):
    made, update = surprised(count)
    mixed = np.tile(update.payload.mean(axis=0), (6, 1))
    concluded = made.conclude(mixed, update)
    plain = made.filter.conclude(mixed[:, :-1], replace(update, payload=update.payload[:, :-1]))
    np.testing.assert_array_equal(concluded.state, plain.state)
    np.testing.assert_array_equal(concluded.covariance, (4.0 if widened else 1.0) * plain.covariance)


def test_an_agent_that_hears_no_neighbour_goes_on_by_prediction_as_without_it():
    made, update = surprised(3)
    inner = replace(update, payload=update.payload[:, :-1])
    alone = made.conclude(update.payload, update)
    np.testing.assert_array_equal(alone.state, made.filter.conclude(inner.payload, inner).state)
    np.testing.assert_array_equal(alone.state, np.zeros((6, 6)))


@pytest.mark.parametrize("others", [(), ("filter.distrust=true",), ("filter.range_std=auto",)])
def test_a_network_that_begins_elsewhere_finds_its_target_sooner(others):
    """Whatever else is put around the filter."""
    alone = "filter.start=given", "filter.reacquire=false"
    start = ["filter.initial_position=[8.0, -8.0, 4.0]", "steps=40", *alone, *others]
    errors = []
    for recovery in ("false", "true"):
        scenario = load("tracking", [*start, f"filter.recovery={recovery}"]).scenario
        traces = simulate([scenario.changed(seed=seed) for seed in range(1, 11)])
        after = [np.linalg.norm((one.estimates - one.truth)[:, 29, :3], axis=1).mean() for one in traces]
        errors.append(np.median(after))
    assert errors[1] < 0.2 * errors[0]


@pytest.mark.slow
@pytest.mark.parametrize("bias", ["estimate", "auto"])
def test_a_network_with_biased_receivers_finds_a_target_that_jumped_and_keeps_its_biases(bias):
    keys = [
        "sensor.bias=0.3",
        "filter.defaults=11",  # which know nothing of that bias
        f"filter.bias={bias}",
        "filter.start=given",
        "filter.reacquire=false",  # or the network finds its target by another fix
        "filter.initial_position=[8.0, -8.0, 4.0]",
    ]
    errors, biases = [], []
    for recovery in ("false", "true"):
        more = [*keys, "steps=80", f"filter.recovery={recovery}"]
        traces = simulate([load("tracking", [*more, f"seed={seed}"]).scenario for seed in range(1, 11)])
        errors.append(np.median([np.linalg.norm((t.estimates[:, 39:, :3] - t.truth[39:, :3]), axis=2) for t in traces]))
        biases.append(np.median([np.abs(trace.diagnostics.bias[:, -1] - 0.3) for trace in traces]))
    assert errors[1] < 0.8 * errors[0]
    assert biases[1] < 0.7 * biases[0]


@pytest.mark.parametrize("rules", [27, 28])
def test_widening_multiplies_the_state_and_leaves_the_biases(rules):
    """And by today's rules their covariance, by earlier ones their correlation."""
    keys = ["filter.bias=estimate", "filter.recovery=true", "filter.start=given", "filter.status=false"]
    keys += [f"filter.defaults={rules}"]
    made = within(Plan(load("tracking", keys).scenario).filter)
    assert isinstance(made, Recovering)
    joint = np.random.default_rng(3).normal(size=(8, 8))
    joint = joint @ joint.T
    memory = (np.zeros((1, 7)), joint[None, :7, :7], np.zeros(1), joint[7:, 7], joint[None, 7, :7])
    wide = widened(made.filter, Belief(np.zeros((1, 6)), joint[None, :6, :6], memory=memory), np.array([4.0]))
    scale = np.array([2.0] * 6 + [1.0, 1.0])
    expected = joint * np.outer(scale, scale)
    if rules == 28:
        expected[:6, 6:], expected[6:, :6] = joint[:6, 6:], joint[6:, :6]
    np.testing.assert_allclose(wide.memory[1][0], expected[:7, :7])
    np.testing.assert_allclose(wide.memory[3], expected[7:, 7])
    np.testing.assert_allclose(wide.memory[4][0], expected[7, :7])


def test_widening_widens_all_motions_and_leaves_how_likely_they_are():
    made = within(
        Plan(
            load("tracking", ["target.motion=circle", "filter.start=given", "filter.status=false", SATURATES]).scenario
        ).filter
    )
    assert isinstance(made, InteractingModels)
    random, chance = np.random.default_rng(3), np.array([[0.1, 0.15, 0.05, 0.2, 0.1, 0.05, 0.15, 0.2]])
    parts = tuple(
        Belief(random.normal(size=(1, motion.size)), np.eye(motion.size)[None]) for motion in made.switching.motions
    )
    wide = widened(made, Belief(*made.mixture(chance, parts), chance=chance, parts=parts), np.array([4.0]))
    for before, after in zip(parts, wide.parts, strict=True):
        np.testing.assert_array_equal(after.state, before.state)
        np.testing.assert_array_equal(after.known_covariance, 4.0 * before.known_covariance)
    assert wide.known_chance is chance
    np.testing.assert_array_equal(wide.state, made.mixture(chance, parts)[0])
    np.testing.assert_allclose(
        wide.known_covariance - made.mixture(chance, parts)[1], 3.0 * np.eye(6)[None], atol=1e-12
    )


def test_outliers_of_which_the_scenario_tells_are_no_sign_of_a_lost_target():
    """With 40 % of them four of six ranges are outliers in one step of seven."""

    def error(*more):
        keys = ["filter.recovery=true", "steps=120", "sensor.outlier_probability=0.4", "sensor.outlier_scale=20", *more]
        traces = simulate([load("tracking", [*keys, f"seed={seed}"]).scenario for seed in (4001, 4002, 4003)])
        return max(float(np.linalg.norm(one.estimates - one.truth, axis=2)[:, 40:].mean()) for one in traces)

    assert error() < 0.3
    assert error("filter.defaults=13") > 2.0 * error()


def test_recovery_is_for_filters_that_average_information():
    with pytest.raises(UserError, match=r"filter\.recovery is for filters that average information"):
        parse({"filter": {"kind": "kcf", "recovery": True}}, "test")
