"""A network in which most innovations are implausible makes room for them; one with a few outliers does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.ranging import Measurement


def surprised(count):
    """A step of six agents of which `count` have a range 10 m too long, and one has none."""
    made = Plan(parse({"filter": {"recovery": True, "start": "given"}}, "test")).filter
    random = np.random.default_rng(1)
    positions = random.uniform(-10.0, 10.0, (6, 3))
    ranges = np.linalg.norm(positions, axis=1)
    ranges[:count] += 10.0
    ranges[5] = np.nan
    belief = Belief(np.zeros((6, 6)), np.tile(0.01 * np.eye(6), (6, 1, 1)))
    empty = np.empty((6, 0, 3)), np.empty((6, 0))
    return made, made.update(belief, Measurement(positions, ranges, np.zeros(6), *empty))


@pytest.mark.parametrize(("count", "widened"), [(0, False), (2, False), (3, True), (5, True)])
def test_covariances_double_in_deviation_where_most_of_those_who_measured_are_surprised(count, widened):
    made, update = surprised(count)
    mixed = np.tile(update.payload.mean(axis=0), (6, 1))
    concluded = made.conclude(mixed, update)
    plain = made.filter.conclude(mixed[:, :-1], replace(update, payload=update.payload[:, :-1]))
    np.testing.assert_array_equal(concluded.state, plain.state)
    np.testing.assert_array_equal(concluded.covariance, (4.0 if widened else 1.0) * plain.covariance)


@pytest.mark.parametrize("others", [(), ("filter.distrust=true",), ("filter.range_std=auto",)])
def test_a_network_that_begins_elsewhere_finds_its_target_sooner(others):
    """Whatever else is put around the filter."""
    start = ["filter.initial_position=[8.0, -8.0, 4.0]", "steps=40", "filter.start=given", *others]
    errors = []
    for recovery in ("false", "true"):
        scenario = load("tracking", [*start, f"filter.recovery={recovery}"]).scenario
        runs = analyze(simulate([scenario.model_copy(update={"seed": seed}) for seed in range(1, 11)]))
        errors.append(np.median([run.position_error[:, 29].mean() for run in runs]))
    assert errors[1] < 0.2 * errors[0]


def test_recovery_is_for_filters_that_average_information():
    with pytest.raises(UserError, match=r"filter\.recovery is for filters that average information"):
        parse({"filter": {"kind": "kcf", "recovery": True}}, "test")
