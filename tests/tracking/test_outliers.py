"""Outliers of which a scenario tells decide what a range counts for."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.outliers import Outliers

CASES = [
    (0.1, 0.5, 0.5, 1.0),
    (3.0, 0.5, 0.5, 1.0),
    (-3.0, 0.5, 0.5, 1.0),
    (40.0, 4.0, 0.5, 5.0),
    (-9.0, 9.0, 0.1, 0.2),
]
"""Innovation, prior variance, noise, mean of the outliers."""


def on_a_grid(innovation, prior, noise, mean, share):
    """Mean, variance and density of the range, of the distance's posterior, all integrals as sums."""
    distance = np.linspace(-9.0, 9.0, 1201) * np.sqrt(prior)
    error = np.linspace(0.0, 30.0 * mean, 1501)
    tail = np.exp(-error / mean) / mean
    off = innovation - distance
    normal = np.exp(-(off**2) / (2.0 * noise)) / np.sqrt(2.0 * np.pi * noise)
    long = np.array([np.trapezoid(tail * np.exp(-((one - error) ** 2) / (2.0 * noise)), error) for one in off])
    likely = (1.0 - share) * normal + share * long / np.sqrt(2.0 * np.pi * noise)
    weight = likely * np.exp(-(distance**2) / (2.0 * prior)) / np.sqrt(2.0 * np.pi * prior)
    density = np.trapezoid(weight, distance)
    middle = np.trapezoid(weight * distance, distance) / density
    return middle, np.trapezoid(weight * (distance - middle) ** 2, distance) / density, density


@pytest.mark.parametrize(("innovation", "prior", "noise", "mean"), CASES)
def test_mean_variance_and_likelihood_are_those_of_the_posterior(innovation, prior, noise, mean):
    values = (np.array([one]) for one in (innovation, np.sqrt(prior + noise), noise))
    found = Outliers(0.3, mean).informed(*values)
    middle, variance, density = on_a_grid(innovation, prior, noise, mean, 0.3)
    after = 1.0 / (1.0 / prior + found.precision[0])
    assert after * found.pull[0] == pytest.approx(middle, rel=1e-4, abs=1e-4)
    assert after == pytest.approx(min(variance, prior), rel=1e-3)
    cost = found.cost[0] + np.log(prior / after) - found.pull[0] ** 2 * after
    assert cost == pytest.approx(-2.0 * np.log(density), abs=1e-3)


def test_without_outliers_to_speak_of_it_is_kalmans_update():
    innovation = np.array([-0.3, 0.0, 0.2])
    found = Outliers(1e-12, 1.0).informed(innovation, np.full(3, np.sqrt(0.05)), np.full(3, 0.01))
    np.testing.assert_allclose(found.precision, 100.0, rtol=1e-6)
    np.testing.assert_allclose(found.pull, 100.0 * innovation, rtol=1e-6, atol=1e-9)


def test_no_range_counts_for_less_than_nothing_or_more_than_its_noise_allows():
    innovation = np.linspace(-1e4, 1e4, 20001)
    for prior in (1e-6, 1.0, 1e6):
        found = Outliers(0.3, 2.0).informed(innovation, np.full(20001, np.sqrt(prior + 0.01)), np.full(20001, 0.01))
        assert np.isfinite(found.cost).all()
        assert found.precision.min() >= 0.0
        assert found.weight(np.full(20001, 0.01)).max() <= 1.0 + 1e-6


def nees(*overrides, seeds=3):
    """Mean of all agents and steps after the first fix, over its ideal."""
    runs = [load("tracking", [*overrides, "steps=120", f"seed={1001 + one}"]).scenario for one in range(seeds)]
    ratios = []
    for trace in simulate(runs):
        off = (trace.estimates - trace.truth)[:, 30:]
        ratios.append(np.einsum("nki,nkij,nkj->nk", off, np.linalg.inv(trace.covariances[:, 30:]), off).mean() / 6.0)
    return float(np.mean(ratios))


SMALL = "agents.count=16", "sensor.outlier_probability=0.3", "sensor.outlier_scale=0.3"


def test_small_outliers_do_not_make_many_agents_too_sure():
    assert nees(*SMALL) < 1.4
    assert nees(*SMALL, "filter.defaults=15") > 1.8


@pytest.mark.parametrize("key", ["filter.saturation=bounded", "filter.xi=2", "filter.kind=icf", "filter.defaults=15"])
def test_where_the_scenario_asks_for_saturation_ranges_saturate(key):
    assert Plan(load("tracking", SMALL).scenario).settings.weighed == Outliers(0.3, 0.3)
    assert Plan(load("tracking", [*SMALL, key]).scenario).settings.weighed is None


def test_a_turn_among_outliers_is_no_silence():
    turns = "target.motion=circle", "sensor.outlier_probability=0.3", "agents.count=13"
    settings = [Plan(load("tracking", [*turns, more]).scenario).settings for more in ("dt=0.1", "filter.defaults=15")]
    assert all(one.models and not one.tells_ranges for one in settings)
    assert [one.bends for one in settings] == [False, True]
