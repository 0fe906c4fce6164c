"""The benchmarks compute what they say; nothing here is timed."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
# The benchmarks are part of the repository, not of the installed package.
sys.path.insert(0, str(ROOT))

from benchmarks import (  # noqa: E402
    accuracy,
    fuzz,
    held_out,
    method_studies,
    realtime,
    recorded,
    rivals,
    several_motions,
    soak,
    stress,
    stress_search,
)
from benchmarks.__main__ import BENCHMARKS  # noqa: E402
from benchmarks.common import analyses, at_least, below, children  # noqa: E402
from benchmarks.fuzz_logs import fuzz_logs  # noqa: E402
from benchmarks.fuzz_material import Material  # noqa: E402
from benchmarks.reach import reaches  # noqa: E402
from benchmarks.rival_process import first_payload  # noqa: E402
from benchmarks.stress import cases, scenario_of  # noqa: E402
from benchmarks.watched_round import STEP, Stopwatch  # noqa: E402
from zenoh_cbef.datasets import read_dataset  # noqa: E402
from zenoh_cbef.scenario.build import batch_tracker  # noqa: E402
from zenoh_cbef.scenario.load import load  # noqa: E402
from zenoh_cbef.scenario.plan import Plan  # noqa: E402
from zenoh_cbef.simulator import simulate  # noqa: E402

SHORT = ("steps=40",)


@pytest.fixture(scope="module")
def tracking():
    return analyses("tracking", SHORT, seeds=3)


def module(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "benchmarks", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )


def test_the_list_names_every_benchmark():
    listed = module("--list")
    assert listed.returncode == 0
    names = [line.split()[0] for line in listed.stdout.splitlines()]
    assert set(names) == set(BENCHMARKS) >= {"accuracy", "lockstep", "filters", "recorded"}


def test_an_unknown_benchmark_is_refused_by_name():
    refused = module("acuracy")
    assert refused.returncode == 2
    assert "acuracy" in refused.stderr
    assert "Traceback" not in refused.stderr


def test_every_seed_is_a_run_of_its_own(tracking):
    assert [run.trace.scenario.seed for run in tracking] == [1, 2, 3]
    assert not np.array_equal(tracking[0].trace.truth, tracking[1].trace.truth)


def test_the_ratio_is_that_of_the_window_s_position_errors(tracking):
    expected = [
        np.sqrt((run.position_error[:, 10:] ** 2).mean() / (run.centralized_position_error[10:] ** 2).mean())
        for run in tracking
    ]
    np.testing.assert_allclose(accuracy.ratios(tracking), expected, rtol=1e-12)


def test_anees_is_the_mean_over_seeds_of_the_squared_whitened_error(tracking):
    found = accuracy.consistency(tracking)
    agent, step, total = 2, 25, 0.0
    for run in tracking:
        error = run.trace.estimates[agent, step] - run.trace.truth[step]
        total += error @ np.linalg.inv(run.trace.covariances[agent, step]) @ error
    assert found.averaged[agent, step] == pytest.approx(total / 3, rel=1e-6)
    assert found.inside + found.under + found.over == pytest.approx(1.0)


def test_the_band_is_that_of_18_degrees_for_3_seeds(tracking):
    # Quantiles of the chi-squared distribution with 18 degrees of freedom, from a table.
    assert accuracy.consistency(tracking).band == pytest.approx((8.2307 / 3, 31.5264 / 3), rel=1e-4)


def test_covariances_that_are_too_small_fall_above_the_band(tracking):
    boasting = [type(run)(**{**vars(run), "nees": 100.0 * run.nees}) for run in tracking]
    assert accuracy.consistency(boasting).over > 0.9
    assert accuracy.consistency(tracking).over < 0.9


def test_outliers_are_compared_with_the_same_seeds():
    dirty = analyses("outliers", SHORT, seeds=2)
    clean = analyses("outliers", [*SHORT, "sensor.outlier_probability=0.0"], seeds=2)
    np.testing.assert_array_equal(dirty[1].trace.truth, clean[1].trace.truth)
    factor = accuracy.outlier_factors(dirty, clean)
    assert factor[0] == pytest.approx(
        (dirty[0].position_error[:, 10:] ** 2).mean() / (clean[0].position_error[:, 10:] ** 2).mean()
    )


def test_the_msee_factor_is_first_over_last():
    runs = analyses("paper", SHORT, seeds=2)
    first, last = runs[1].msee_average[[0, -1]]
    assert accuracy.msee_factors(runs)[1] == pytest.approx(first / last)


def test_the_error_radius_is_how_fast_unsaturated_errors_grow():
    # A cube in which the literal filter diverges, without noise; few enough steps to stay below any bound.
    overrides = [
        "steps=16",
        "agents.high=2.5",
        "target.position=[1.2, 1.2, 1.2]",
        "target.acceleration_std=0.0",
        "filter.initial_velocity=[0.0, 0.0, 0.0]",
        "sensor.range_std=1e-9",
        "sensor.signal_speed=1.0",
        method_studies.NO_SATURATION,
    ]
    (run,) = analyses("paper", overrides, seeds=1)
    radius = method_studies.error_radius(run.trace.scenario)
    assert radius > 1.0
    grown = np.linalg.norm(run.position_error, axis=0)
    assert grown[-1] / grown[-2] == pytest.approx(radius, rel=1e-3)


def test_the_carried_velocity_is_the_literal_filter_s():
    (run,) = analyses("paper", SHORT, seeds=1)
    mean = run.trace.estimates[:, :, 3:].mean(axis=0) - run.trace.truth[:, 3:]
    np.testing.assert_allclose(np.linalg.norm(mean, axis=1), method_studies.carried_velocity(run), atol=1e-12)


def test_the_largest_eigenvalue_grows_with_the_square_of_the_size():
    scenario = load("paper").scenario
    twice = load("paper", ["agents.high=1.6"]).scenario
    ratio = method_studies.largest_eigenvalue(twice) / method_studies.largest_eigenvalue(scenario)
    assert ratio == pytest.approx(4.0)


def test_targets_are_judged_on_the_value():
    assert below("a", 0.9, 1.0).reached is True
    assert below("a", 1.0, 1.0).reached is False
    assert at_least("a", 1.0, 1.0).reached is True
    assert at_least("a", 0.9, 1.0).reached is False


def start_and_be_interrupted(started):
    with children() as family:
        started.append(family.start("http.server", ["--bind", "127.0.0.1", "0"], {}))
        raise KeyboardInterrupt


def test_no_child_outlives_its_block():
    started: list[subprocess.Popen] = []
    with pytest.raises(KeyboardInterrupt):
        start_and_be_interrupted(started)
    assert started[0].returncode is not None


def test_a_child_that_fails_is_quoted():
    with children() as family, pytest.raises(RuntimeError, match="no_such_module"):
        family.wait(family.start("no_such_module", [], {}, listen_to=True), 30.0)


def test_a_made_up_set_has_the_bias_noise_and_outliers_it_claims(tmp_path):
    kind = held_out.KINDS["large field"]
    held_out.write(kind, 4, tmp_path)
    dataset = read_dataset(tmp_path)
    places = dataset.truth_at(dataset.range_time)[:, :3]
    errors = dataset.ranges - np.linalg.norm(places - dataset.anchors[dataset.range_anchor], axis=1)
    assert abs(np.median(errors) - kind.common) < 3.0 * kind.own
    low, high = np.percentile(errors, [5, 95])
    assert np.median(errors) - low == pytest.approx(1.645 * kind.std, rel=0.2)
    # Outliers are late only.
    assert high - np.median(errors) > 1.3 * (np.median(errors) - low)
    assert dataset.interval == pytest.approx(1.0 / np.mean(kind.rate), rel=0.05)


def test_a_slope_is_known_no_better_than_its_samples_allow():
    noise = np.random.default_rng(1).normal(size=1000)
    flat = [(float(second), 100.0 + wobble) for second, wobble in enumerate(noise)]
    growing = [(second, size + 0.02 * second) for second, size in flat]
    rate, half = soak.slope(flat)
    assert abs(rate) < half < 0.001
    rate, half = soak.slope(growing)
    assert rate - half > 0.019
    # One that wanders is not as sure of it as its many samples make it look.
    size, wandering = 0.0, []
    for second, step in enumerate(noise):
        size = 0.9 * size + step
        wandering.append((float(second), size))
    rate, half = soak.slope(wandering)
    assert abs(rate) < half
    assert half > 0.002
    assert np.isnan(soak.slope(flat[:3])[0])


def test_time_within_an_inner_place_is_not_counted_twice(monkeypatch):
    now = [0]
    monkeypatch.setattr("time.perf_counter_ns", lambda: now[0])
    watch = Stopwatch()

    def passes(nanoseconds, then=lambda: None):
        now[0] += nanoseconds
        then()
        now[0] += nanoseconds

    inner = watch.around(passes, "mix")
    for count in (1, 2, 3):
        watch.around(passes, "read")(10 * count, lambda: inner(1))
        passes(50)
        if count == 3:
            watch.around(passes, "wake-up")(1)
        watch.enter(STEP)
        watch.turn()
    assert watch.medians() == {"mix": 2, "read": 40, "wake-up": 0, STEP: 100}


def test_whatever_is_fed_into_a_decoder_is_accepted_or_refused(tmp_path):
    found = fuzz.feed(tmp_path, 1000, 320)
    assert [end for each in found.values() for end in each if end.startswith("crash")] == []
    # Otherwise nothing was looked at beyond the first check.
    assert all(each["accepted"] for each in found.values())


def test_every_verb_ends_with_a_status_on_mutated_logs(tmp_path):
    ends = fuzz_logs(tmp_path, 5, range(3))
    assert {"check", "verify", "analyze", "timeline", "recover", "playlist"} <= ends.keys()
    assert {end for each in ends.values() for end in each} <= {f"status {status}" for status in range(4)}


def test_a_crash_is_told_as_one():
    def broken(_):
        raise IndexError("of no list")

    assert fuzz.through(broken, Material(1)).startswith("crash: IndexError at test_benchmarks.py")


def test_every_case_of_stress_is_a_scenario_and_a_lost_network_is_counted():
    for case in stress.cases().values():
        stress.scenario_of(case)
    scenario = stress.scenario_of({"set": ["steps=60"]}, ["consensus.rounds=0"])
    found = stress.scores(scenario, seeds=2)
    assert (found.lost(found.network), found.lost(found.twin), found.lost(found.strong)) == (2, 0, 0)
    assert (replace(found, tracking=np.array([0.4, 0.6])).unaware, replace(found, network=found.twin).unaware) == (1, 0)
    bounded = {"set": ["steps=60", "filter.saturation=bounded", "filter.defaults=2"]}
    liar = stress.scores(stress.scenario_of(bounded), "liar", seeds=2)
    assert (liar.twin > 2.0 * liar.strong).all()


def test_an_unknown_case_of_stress_is_refused_by_name():
    refused = module("stress", "--case", "nowhere")
    assert refused.returncode == 2
    assert "nowhere" in refused.stderr
    assert "Traceback" not in refused.stderr


def test_steps_of_silence_are_those_long_after_the_last_range():
    keys = ["steps=60", 'fault=[{kind="sensor-dropout",probability=1.0,from=1.0,until=4.0}]']
    [run] = simulate([load("tracking", keys).scenario])
    silent = recorded.silent_steps(run)
    assert run.time[silent].min() == pytest.approx(3.0, abs=0.11)
    assert run.time[silent].max() == pytest.approx(4.0, abs=0.11)


def test_what_a_search_finds_is_kept_once_as_a_case(tmp_path, monkeypatch):
    monkeypatch.setattr(stress_search, "CASES", tmp_path / "stress.toml")
    monkeypatch.setattr(stress, "CASES", tmp_path / "stress.toml")
    (tmp_path / "stress.toml").write_text("")
    case = {"set": ["dt=0.5", 'fault=[{kind="loss",probability=0.6}]'], "wrong": "liar"}
    nothing = np.ones(2)
    found = stress_search.Found(case, stress.Scores(4.0 * nothing, *6 * [nothing]))
    assert found.excess == 2
    name = stress_search.keep(found)
    assert stress.cases() == {name: case}
    assert stress_search.keep(found) == ""


@pytest.mark.processes
@pytest.mark.parametrize("acceleration", ["none", "chebyshev"])
@pytest.mark.parametrize("way", rivals.PACKAGES)
def test_a_rival_s_processes_average_as_agents_do(way, acceleration):
    if missing := rivals.lacking(way):
        pytest.skip(missing)
    plan = load("tracking", [f"consensus.acceleration={acceleration}"]).plan
    tracker, neighbours = batch_tracker([plan])
    stage = tracker.consensus
    message = stage.start(np.array([first_payload(agent, plan.message_size) for agent in range(6)]))
    for _ in range(plan.rounds):
        message = stage.mix(message[neighbours.index], neighbours.present)
    found = rivals.rival(plan, way, 3, batch=True)
    assert [one.me for one in found] == [*range(6)]
    np.testing.assert_array_equal([one.values for one in found], stage.result())


def point(late):
    return realtime.Point(late, np.array([0.001]), slowest=0.0, beacons=0.0)


@pytest.mark.parametrize("capacity", [0.5, 1.0, 7.5, 9.0, 20.0])
def test_the_highest_rate_on_time_is_the_last_that_holds(capacity):
    rungs = [float(rate) for rate in range(1, 11)]
    tried = list[float]()

    def run_at(rate):
        tried.append(rate)
        return point(0.0 if rate <= capacity else 0.01)

    rate, points = realtime.on_time(run_at, rungs, 3)
    assert rate == max(1.0, min(10.0, capacity // 1.0))
    assert len(points) == 3
    assert len(tried) <= 2 * 4 + 3


def test_a_rate_that_was_on_time_by_chance_is_given_up_for_the_one_below():
    lates = {4.0: iter([0.0, 0.01, 0.01, 0.0])}
    rate, points = realtime.on_time(
        lambda rate: point(next(lates[rate]) if rate in lates else 0.01 * (rate > 4.0)), [1.0, 2.0, 3.0, 4.0, 5.0], 3
    )
    assert rate == 3.0
    assert [one.late for one in points] == [0.0, 0.0, 0.0]


@pytest.mark.processes
def test_messages_that_come_late_and_those_that_never_come_count_as_late(monkeypatch):
    monkeypatch.setattr(realtime, "_SECONDS", 0.02)
    found = realtime.measure("tracking", 10, 5000.0)
    assert found.late > 0.1
    assert found.slowest > 0.1
    assert (found.latency > 0.0).all()
    assert len(found.latency) > 0
    lossy = realtime.measure("tracking", 2, 10.0, ['fault=[{kind="loss",probability=0.4}]'])
    assert lossy.late > 0.3


def test_a_yardstick_has_the_ranges_that_reach_an_agent_and_no_others() -> None:
    crash = 'fault=[{kind="crash",agents=[2],from=1.0,until=2.0},{kind="byzantine",mode="constant",agents=[4]}]'
    chosen = ["agents.count=6", "network.graph=path", "steps=40", crash]
    (trace,) = simulate([load("tracking", chosen).scenario])
    found = {tuple(each.agents): np.isfinite(each.trace.ranges) for each in reaches(trace)}
    assert list(found) == [(0, 1), (3,), (5,)], "the path is cut at the liar, and at the agent that is away"
    away = (trace.time >= 1.0) & (trace.time < 2.0)
    for agents, heard in found.items():
        assert heard[list(agents)].all(), "an agent's own ranges reach it"
    assert heard_of(found[0, 1], ~away) == {0, 1, 2, 3}
    assert heard_of(found[0, 1], away) == {0, 1}
    assert heard_of(found[3,], away) == {3}
    assert heard_of(found[5,], ~away) == {5}


def heard_of(heard: np.ndarray, steps: np.ndarray) -> set[int]:
    """The agents of whom a range is there in all of the steps."""
    assert set(heard[:, steps].mean(axis=1).tolist()) <= {0.0, 1.0}
    return set(np.flatnonzero(heard[:, steps].all(axis=1)).tolist())


@pytest.mark.parametrize("case", several_motions.CASES)
def test_other_calm_motions_stand_beside_the_agile_ones_that_a_plan_assumes(case):
    keys = cases()[case]
    plan = Plan(scenario_of(keys))
    for noises, switching in several_motions.CALM.values():
        other = Plan(scenario_of(keys, several_motions.keys(plan, noises, switching)))
        assert len(other.models) == 2 * len(noises) + len(plan.models) - 2
        assert other.models[-1].acceleration_std == plan.models[-1].acceleration_std
