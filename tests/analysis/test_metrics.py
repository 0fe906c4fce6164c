"""Metrics are what their definitions say, computed here by plain loops."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.analysis.averages import mean, means, middle, running_mean
from zenoh_cbef.analysis.chi2 import chi2_quantile
from zenoh_cbef.analysis.metrics import analyze, notes
from zenoh_cbef.analysis.results import Messages
from zenoh_cbef.analysis.summary import pick, summarize
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.simulator import simulate
from zenoh_cbef.trace import Traffic


def scenario(seed=1, **keys):
    base = {"steps": 40, "sensor": {"dropout_probability": 0.1}, "fault": [{"kind": "loss", "probability": 0.2}]}
    return parse({"seed": seed, **base, **keys}, "test")


@pytest.fixture(scope="module")
def trace():
    return simulate([scenario()])[0]


@pytest.fixture(scope="module")
def analysis(trace):
    return analyze([trace])[0]


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_msee_is_the_papers_running_mean_from_the_first_step(trace, analysis):
    for agent in range(6):
        total = 0.0
        for k in range(40):
            total += sum((trace.estimates[agent, k, c] - trace.truth[k, c]) ** 2 for c in range(6))
            assert analysis.msee[agent, k] == pytest.approx(total / (k + 1), rel=1e-12)
    np.testing.assert_allclose(analysis.msee_average, analysis.msee.mean(axis=0), rtol=1e-12)
    assert analysis.metrics.msee.agents == pytest.approx(analysis.msee[:, -1].tolist())
    assert analysis.metrics.msee.average == pytest.approx(analysis.msee[:, -1].mean())


def test_runs_that_are_analysed_together_have_the_figures_of_each_alone():
    alike = simulate([scenario(seed) for seed in (1, 2, 3)])
    short = alike[0].estimates.copy()
    short[:, 20:] = np.nan
    for runs in (alike, [*alike, replace(alike[0], estimates=short)]):
        together = [one.metrics for one in analyze(runs)]
        assert together == [analyze([one])[0].metrics for one in runs]
    assert [one.skip for one in together] == [10, 10, 10, 5], "windows differ"


def test_means_and_medians_of_rows_are_those_of_their_known_values():
    rows = np.random.default_rng(1).normal(size=(3, 4, 50))
    rows[0, 1, ::3] = rows[1, 2] = np.nan
    for row, mean_of, median in zip(rows.reshape(-1, 50), means(rows).ravel(), middle(rows).ravel(), strict=True):
        assert mean(row) == (None if np.isnan(mean_of) else mean_of), "to the last bit"
        assert np.isnan(row).all() == np.isnan(median)
        if not np.isnan(row).all():
            assert median == np.nanmedian(row)


def test_a_running_mean_leaves_out_steps_without_a_value():
    nan = np.nan
    np.testing.assert_allclose(running_mean(np.array([nan, 2.0, nan, 4.0, 3.0])), [nan, 2.0, 2.0, 3.0, 3.0])
    assert np.isnan(running_mean(np.full((2, 3), nan))).all()


@pytest.mark.parametrize(("skip", "first"), [(0.0, 0), (0.25, 10), (0.5, 20), (0.999, 39), (1.0, 39)])
def test_errors_are_scored_after_the_skipped_share(trace, skip, first):
    [one] = analyze([trace], skip)
    error = (trace.estimates - trace.truth)[:, first:]
    metrics = one.metrics
    assert metrics.skip == one.first == first
    assert metrics.position_rmse == pytest.approx(rms(np.linalg.norm(error[:, :, :3], axis=2)))
    assert metrics.velocity_rmse == pytest.approx(rms(np.linalg.norm(error[:, :, 3:], axis=2)))
    central = rms(np.linalg.norm((one.centralized_states - trace.truth)[first:, :3], axis=1))
    assert metrics.centralized.position_rmse == pytest.approx(central)
    assert metrics.ratio_to_centralized == pytest.approx(metrics.position_rmse / central)
    bound = np.sqrt(np.mean([np.trace(one.bound[k, :3, :3]) for k in range(first, 40)]))
    assert metrics.bound.position_rmse == pytest.approx(bound)


def test_nees_is_the_squared_error_in_units_of_the_claimed_covariance(trace, analysis):
    low, high = analysis.nees_band
    assert (low, high) == pytest.approx((1.237344, 14.449375), rel=1e-5)
    values = np.empty((6, 40))
    for agent in range(6):
        for k in range(40):
            error = trace.estimates[agent, k] - trace.truth[k]
            values[agent, k] = error @ np.linalg.inv(trace.covariances[agent, k]) @ error
    np.testing.assert_allclose(analysis.nees, values, rtol=1e-6)
    window, nees = values[:, 10:], analysis.metrics.nees
    assert nees.average == pytest.approx(window.mean())
    assert nees.agents == pytest.approx(window.mean(axis=1).tolist())
    assert nees.inside == pytest.approx(((window >= low) & (window <= high)).mean())
    assert nees.dimension == 6


def test_nees_of_a_plane_counts_the_estimated_components_only():
    keys = {"filter": {"planar_height": 0.0}, "target": {"acceleration_std": 0.0}}
    [trace] = simulate([scenario(**keys)])
    [one] = analyze([trace])
    assert pick(one.metrics, "nees.dimension") == 4
    assert one.nees_band == (chi2_quantile(0.025, 4), chi2_quantile(0.975, 4))
    kept = [0, 1, 3, 4]
    error = (trace.estimates[2, 7] - trace.truth[7])[kept]
    assert one.nees[2, 7] == pytest.approx(error @ np.linalg.inv(trace.covariances[2, 7][np.ix_(kept, kept)]) @ error)


def test_a_filter_without_covariance_has_no_nees():
    [one] = analyze(simulate([load("paper", ["steps=20"]).scenario]))
    assert one.metrics.nees is None
    assert np.isnan(one.nees).all()


def test_disagreement_is_the_spread_of_the_agents_positions(trace, analysis):
    for k in range(40):
        positions = trace.estimates[:, k, :3]
        expected = np.sqrt(np.mean(np.sum((positions - positions.mean(axis=0)) ** 2, axis=1)))
        assert analysis.disagreement[k] == pytest.approx(expected)
    assert analysis.metrics.disagreement == pytest.approx(rms(analysis.disagreement[10:]))


def test_steps_an_agent_did_not_reach_are_left_out(trace):
    estimates, covariances = trace.estimates.copy(), trace.covariances.copy()
    estimates[2, 25:], covariances[2, 25:] = np.nan, np.nan
    estimates[3], covariances[3] = np.nan, np.nan
    [one] = analyze([replace(trace, estimates=estimates, covariances=covariances)])
    metrics = one.metrics
    error = (trace.estimates - trace.truth)[:, 10:, :3]
    distances = np.linalg.norm(error, axis=2)
    scored = np.concatenate([distances[2, :15], *distances[[0, 1, 4, 5]]])
    assert metrics.position_rmse == pytest.approx(rms(scored))
    assert metrics.msee.agents[3] is None
    assert metrics.msee.agents[2] == pytest.approx(one.msee[2, 24])
    assert metrics.nees is not None
    assert metrics.nees.agents[3] is None
    assert np.isfinite(one.disagreement).all()
    json.dumps(metrics.as_json(), allow_nan=False)


def test_the_links_and_messages_are_those_of_the_trace(trace):
    trace = replace(trace, traffic=Traffic(10, 9, 1, 2))
    metrics = analyze([trace])[0].metrics
    assert metrics.messages == Messages(sent=10, recorded=9, missing=1, rejected=2)
    links = metrics.links
    assert [(one.source, one.destination) for one in links] == list(
        zip(trace.links.source.tolist(), trace.links.destination.tolist(), strict=True)
    )
    for one in links:
        assert one.sent == one.delivered + one.lost + one.late == 400
        assert one.latency is None


def test_metrics_are_json_with_what_was_promised(analysis):
    metrics = json.loads(json.dumps(analysis.metrics.as_json(), allow_nan=False))
    assert metrics == analysis.metrics.as_json()
    promised = {
        "run", "filter", "agents", "steps", "msee", "position_rmse", "velocity_rmse", "centralized",
        "ratio_to_centralized", "bound", "nees", "disagreement", "messages", "links",
    }  # fmt: skip
    assert metrics.keys() >= promised
    assert [metrics[name] for name in ("run", "filter", "agents", "steps")] == ["tracking", "sicf", 6, 40]
    assert metrics["centralized"].keys() >= {"position_rmse", "velocity_rmse"}


def test_runs_are_analysed_alike_alone_and_together():
    traces = simulate([scenario(seed) for seed in (1, 2, 3)])
    together = analyze(traces)
    for trace, one in zip(traces, together, strict=True):
        assert analyze([trace])[0].metrics == one.metrics


def test_the_reference_saturates_only_where_the_filter_does():
    outliers = {"sensor": {"outlier_probability": 0.3}, "steps": 60, "fault": []}
    errors = {}
    for kind in ("sicf", "icf"):
        [one] = analyze(simulate([scenario(**outliers, filter={"kind": kind, "xi": 1.0})]))
        errors[kind] = pick(one.metrics, "centralized.position_rmse")
    assert errors["sicf"] < 0.5 * errors["icf"]


@pytest.mark.slow
def test_the_recommended_filter_is_near_the_centralised_one_and_honest():
    analyses = analyze(simulate([load("tracking", [f"seed={seed}", "steps=200"]).scenario for seed in range(12)]))
    ratios = [pick(one.metrics, "ratio_to_centralized") for one in analyses]
    assert 0.98 < np.median(ratios) < 1.05
    nees = np.mean([pick(one.metrics, "nees.average") for one in analyses])
    assert 4.0 < nees < 8.0
    bounds = [one.metrics.bound.position_rmse for one in analyses]
    central = [one.metrics.centralized.position_rmse for one in analyses]
    assert 0.8 < rms(bounds) / rms(central) < 1.2


@pytest.fixture(scope="module")
def circling():
    keys = ["steps=150", "target.motion=circle", "target.period=8", "filter.acceleration_std=0.1", "filter.motion=ncv"]
    loaded = load("tracking", keys).scenario
    return analyze(simulate([loaded.changed(seed=seed) for seed in (1, 2)]))


@pytest.mark.slow
def test_a_twin_that_is_lost_with_the_network_is_told_and_so_is_what_can_be_reached(circling):
    for one in circling:
        metrics = one.metrics
        assert metrics.ratio_to_centralized < 1.5
        assert metrics.ratio_to_strong > 3.0
        assert metrics.ratio_to_strong == pytest.approx(metrics.position_rmse / metrics.strong.position_rmse)
        assert metrics.lost
        assert metrics.twin_lost
        assert "lost the target itself" in " ".join(notes(metrics))
    told = summarize([one.metrics for one in circling])
    assert (told.share_lost, told.share_twin_lost) == (1.0, 1.0)
    spread = told.spreads["ratio_to_strong"]
    assert spread is not None
    assert spread.p90 == max(one.metrics.ratio_to_strong for one in circling)


def test_a_centralised_filter_near_the_bound_is_the_strong_yardstick(analysis):
    metrics = analysis.metrics
    assert metrics.strong == metrics.centralized
    assert metrics.ratio_to_strong == metrics.ratio_to_centralized
    assert metrics.ratio_to_bound == pytest.approx(metrics.position_rmse / metrics.bound.position_rmse)
    assert not metrics.lost
    assert not metrics.twin_lost
    assert not any("itself" in said for said in notes(metrics))


def test_errors_clearly_below_the_bound_are_explained(analysis):
    assert not any("times the bound" in said for said in notes(analysis.metrics))
    assert not notes(replace(analysis.metrics, ratio_to_bound=0.42, steps=99, skip=0)), "of few steps by chance"
    [said] = notes(replace(analysis.metrics, ratio_to_bound=0.42, steps=300, skip=75))
    assert said.startswith("the error is 0.42 times the bound, which is a mean over targets that accelerate by")


def test_the_bound_starts_from_the_mean_of_all_guesses(trace, analysis):
    motion = trace.plan.plain_motion
    prior = np.eye(6) / 6.0
    information = np.linalg.inv(motion.transition @ prior @ motion.transition.T + motion.process_noise)
    for position, measured in zip(trace.positions[:, 0], trace.ranges[:, 0], strict=True):
        if np.isfinite(measured):
            away = trace.truth[0, :3] - position
            row = np.concatenate([away / np.linalg.norm(away), np.zeros(3)])
            information += np.outer(row, row) / 0.01
    np.testing.assert_allclose(analysis.bound[0], np.linalg.inv(information), rtol=1e-9)
