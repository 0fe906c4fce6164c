"""NEES and NIS of every filter against the chi-squared distribution: who is honest, who is not, and that both show."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks.accuracy import over_seeds
from zenoh_cbef.analysis.consistency import chi2_band, described, nees_of, trailing_mean
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

SEEDS, STEPS, FIRST = 20, 140, 35
# ANEES of twenty seeds lies in this band in 95 % of the steps for a consistent filter; agents that agree and steps
# that follow each other fall out of it together, so 90 % is asked for.
HONEST = 0.9


@cache
def runs(kind, *overrides):
    settings = [f"filter.kind={kind}", f"steps={STEPS}", *overrides]
    return simulate([load("tracking", [f"seed={seed}", *settings]).scenario for seed in range(1, SEEDS + 1)])


def nees(kind, *overrides):
    found = [nees_of(one.estimates - one.truth, one.covariances) for one in runs(kind, *overrides)]
    return over_seeds(np.stack(found), 6, FIRST)


def nis(kind, *overrides):
    return over_seeds(np.stack([one.diagnostics.nis for one in runs(kind, *overrides)]), 1, FIRST)


@pytest.mark.parametrize("kind", ["sicf", "icf", "hcmci"])
def test_with_enough_rounds_the_information_filters_are_consistent(kind):
    errors, innovations = nees(kind), nis(kind)
    assert errors.inside > HONEST
    assert errors.band[0] < errors.mean < errors.band[1]
    assert innovations.inside > HONEST
    # Innovations are white, so all of them together have a band of their own, some percent wide.
    assert innovations.mean == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("kind", ["sicf", "icf", "hcmci"])
def test_with_one_round_they_are_somewhat_too_confident(kind):
    errors = nees(kind, "consensus.rounds=1")
    assert 0.05 < errors.over < 0.5
    assert errors.mean > 1.05 * nees(kind).mean


@pytest.mark.slow
def test_covariance_intersection_is_too_modest_with_any_number_of_rounds():
    for overrides in ((), ("consensus.rounds=1",)):
        errors, innovations = nees("ci", *overrides), nis("ci", *overrides)
        assert errors.under > 0.8
        assert errors.over < 0.01
        assert innovations.mean < 0.95


def test_diffusion_is_too_confident_as_its_covariance_ignores_the_combination():
    errors = nees("diffusion")
    assert errors.over > 0.3
    assert errors.mean > 6.6


def test_kcf_is_too_confident_where_a_neighbourhood_does_not_show_the_target():
    # On a ring an agent hears three ranges, which leave a mirror image: some agents settle there, sure of themselves.
    assert nees("kcf", "network.graph=ring", "consensus.rounds=1").over > 0.3


def test_an_agent_alone_is_wrong_and_sure_of_it_and_its_own_innovations_do_not_show_it():
    # One range does not show the target. Linearising it at the wrong place gives information that is not there.
    assert nees("local").over > 0.99
    assert nis("local").inside > HONEST


@pytest.mark.parametrize("kind", ["cbef", "cbef-scaled"])
def test_filters_without_covariance_claim_nothing(kind):
    [one] = analyze(simulate([load("paper", ["steps=20", f"filter.kind={kind}"]).scenario]))
    assert one.metrics.nees is None
    assert one.metrics.nis is None


@pytest.mark.slow
def test_the_nis_shows_a_wrong_noise_without_the_truth():
    honest = nis("icf").mean
    assert nis("icf", "filter.range_std=0.05").mean > 2.0 * honest
    assert nis("icf", "filter.range_std=0.2").mean < 0.5 * honest


def test_saturation_does_not_hide_outliers_from_the_nis():
    assert nis("sicf", "sensor.outlier_probability=0.1").mean > 20.0


def test_a_band_is_the_tables_quantiles():
    # Quantiles of the chi-squared distribution with 1 and 20 degrees of freedom, from a table.
    assert chi2_band(1) == pytest.approx((0.000982, 5.0239), rel=1e-3)
    assert chi2_band(1, 20) == pytest.approx((9.591 / 20, 34.170 / 20), rel=1e-3)


def test_what_the_metrics_say_is_what_plain_loops_say():
    random = np.random.default_rng(1)
    degrees = random.integers(0, 3, size=(2, 50))
    values = np.where(degrees > 0, random.chisquare(np.maximum(degrees, 1)), np.nan)
    time = 0.1 * np.arange(1.0, 51.0)
    [found] = described(values[None], degrees[None], time=time, first=10, counted=np.ones(len(values), dtype=bool))
    scored, inside = [], []
    for agent in range(2):
        for k in range(10, 50):
            if degrees[agent, k]:
                low, high = chi2_band(degrees[agent, k])
                scored.append(values[agent, k])
                inside.append(low <= values[agent, k] <= high)
    assert found is not None
    assert found.average == pytest.approx(np.mean(scored))
    assert found.inside == pytest.approx(np.mean(inside))
    assert found.over_time.until[0] == pytest.approx(0.2)
    assert found.over_time.until[-1] == pytest.approx(5.0)
    assert found.over_time.agents[1][-1] == pytest.approx(np.nanmean(values[1, 47:]))


def test_an_agents_mean_nis_lies_in_its_own_band():
    [one] = analyze(runs("icf")[:1])
    assert one.first == FIRST
    metrics = one.metrics.nis
    assert metrics is not None
    for agent, (band, found) in enumerate(zip(metrics.agents_band, metrics.agents, strict=True)):
        count = np.isfinite(one.trace.diagnostics.nis[agent, one.first :]).sum()
        assert band is not None
        assert found is not None
        assert band == pytest.approx(chi2_band(1, int(count)))
        assert band[0] * 0.8 < found < band[1] * 1.2
    assert metrics.dimension == 1


def test_a_trailing_mean_is_the_sum_over_the_degrees_of_the_last_steps():
    values, degrees = np.array([[1.0, np.nan, 4.0, 3.0, 2.0]]), np.array([[1, 0, 2, 1, 1]])
    expected = [1.0, np.nan, 5.0 / 3.0, 7.0 / 3.0, 9.0 / 4.0]
    np.testing.assert_allclose(trailing_mean(values, degrees, 3)[0], expected)
