"""An outlier pulls little, whatever the prior: a saturated range that widens its whole innovation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.unaided import centralised
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters import Belief, make_filter
from zenoh_cbef.tracking.filters.weighing import saturated_precision
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours

TURNS = (
    "target.motion=waypoints", "target.speed=3", "target.waypoints=[[0,0,0],[6,6,0],[-6,6,3],[6,-6,-3],[0,0,0]]",
    "sensor.outlier_probability=0.3", "sensor.outlier_scale=20", "steps=110",
)  # fmt: skip


def runs(*more, seeds=3):
    scenario = load("tracking", [*TURNS, *more]).scenario
    return simulate([scenario.changed(seed=2001 + seed) for seed in range(seeds)])


def errors(traces):
    off = np.stack([trace.estimates - trace.truth for trace in traces])[:, :, 40:, :3]
    return np.sqrt(np.mean(np.sum(off**2, axis=3), axis=(1, 2)))


def test_a_range_that_fits_counts_alike():
    weight, variance, spread = np.array([1.0, 1.0, 0.0]), np.full(3, 0.01), np.array([0.2, 5.0, 1.0])
    for widens in (0.0, 0.5, 1.0):
        assert saturated_precision(weight, variance, spread, widens=widens).tolist() == [100.0, 100.0, 0.0]


def test_halfway_is_the_geometric_mean_of_what_is_added_to_the_noise():
    weight, variance, spread = np.array([0.04]), np.array([0.01]), np.array([3.0])
    noise, half, whole = (1.0 / saturated_precision(weight, variance, spread, widens=one) for one in (0.0, 0.5, 1.0))
    assert half - variance == pytest.approx(np.sqrt((noise - variance) * (whole - variance)))


def test_the_innovation_has_the_variance_of_its_weight():
    weight, variance, prior = np.array([0.04]), np.array([0.01]), 3.0
    precision = saturated_precision(weight, variance, np.sqrt(prior + variance), widens=1.0)
    assert prior + 1.0 / precision == pytest.approx((prior + variance) / weight)


@pytest.mark.parametrize(("widens", "least", "most"), [(0.0, 5.0, 20.0), (0.5, 1.0, 5.0), (1.0, 0.0, 0.5)])
def test_how_far_an_outlier_pulls_from_a_wide_prior(widens, least, most):
    settings = replace(Plan(load("tracking", []).scenario).settings, network_size=1, power=2, xi=2.0, widens=widens)
    filter_ = make_filter("sicf", replace(settings, first_fix=0, says_status=False, reacquires=0, supposes=False))
    belief = Belief(np.zeros((1, 6)), np.diag([1.0] * 3 + [0.01] * 3)[None])
    away = np.array([[10.0, 0.0, 0.0]])
    measurement = Measurement(away, np.array([30.0]), np.zeros(1), *no_neighbours(1))
    update = filter_.update(belief, measurement)
    moved = -filter_.conclude(update.payload, update).state[0, 0]
    assert least < moved < most


@pytest.mark.slow
def test_a_network_holds_turns_among_outliers_as_a_centralised_filter_does():
    traces = runs()
    assert np.median(errors(traces)) < 0.5
    central = centralised(traces)[:, 40:, :3]
    truth = np.stack([trace.truth for trace in traces])[:, 40:, :3]
    yardstick = np.sqrt(np.mean(np.sum((central - truth) ** 2, axis=2), axis=1))
    assert np.median(errors(traces) / yardstick) < 1.2


@pytest.mark.slow
def test_by_the_rules_of_before_it_is_lost():
    assert np.median(errors(runs("filter.defaults=6"))) > 1.0
