"""A scenario with recorded ranges: how many agents and steps, what is assumed, and what is scored."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.datasets.made import scenario_of, write
from zenoh_cbef.analysis.design import design
from zenoh_cbef.analysis.metrics import analyze, notes
from zenoh_cbef.datasets import read_dataset
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.start import initial_std
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import heard_in, simulate

MIRRORED, TWO = {0: 2, 1: 3, 2: 0, 3: 1}, {0: 1, 1: 0, 2: 2, 3: 3}
TRUTH = "the truth does not fit the estimates, which fit the ranges: NEES is"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "factor", "swapped", "way", "late", "said"),
    [
        ("filter.kind=sicf", 1.0, None, 1.0, 0.0, ""),
        ("filter.range_std=auto", 1.0, None, 1.0, 0.0, ""),
        ("filter.kind=sicf", 5.0, None, 1.0, 0.0, "the ranges do not fit the estimates: half of"),
        ("filter.range_std=auto", 1.0, TWO, 1.0, 0.0, "the ranges do not fit the estimates: half of"),
        ("filter.kind=cbef", 1.0, TWO, 1.0, 0.0, "the ranges do not fit the estimates: half of"),
        ("filter.kind=sicf", 1.0, MIRRORED, 1.0, 0.0, TRUTH),  # they fit a target on the other side
        ("filter.kind=sicf", 1.0, None, 1000.0, 0.0, TRUTH),  # in mm
        ("filter.kind=sicf", 1.0, None, 1.0, 3.0, TRUTH),
    ],
)
def test_ranges_that_do_not_fit_the_positions_are_said_to(tmp_path, *, how, factor, swapped, way, late, said):
    corners = {0: (0.0, 0.0), 1: (20.0, 0.0), 2: (20.0, 15.0), 3: (0.0, 15.0)}
    named = swapped or {each: each for each in corners}
    times = [0.1 * k for k in range(120)]  # Longer than agents leave a bias open.
    path = [(10.0 + 6.0 * math.cos(t / 3.0), 7.0 + 5.0 * math.sin(t / 3.0)) for t in times]
    anchors = "id,x,y,z\n" + "".join(f"{each},{x},{y},1\n" for each, (x, y) in corners.items())
    truth = "t,x,y,z\n" + "".join(f"{t + late},{way * x},{way * y},1\n" for t, (x, y) in zip(times, path, strict=True))
    ranges = "t,anchor_id,range\n" + "".join(
        f"{t},{named[each]},{factor * math.dist(at, here)}\n"
        for t, here in zip(times, path, strict=True)
        for each, at in corners.items()
    )
    folder = write(tmp_path, anchors=anchors, ranges=ranges, truth=truth)
    settings = ["target.motion=dataset", f'target.path="{folder}"', "filter.planar_height=1", how]
    told = notes(analyze([simulate([load("tracking", settings).scenario])[0]])[0].metrics)
    misfits = [each for each in told if "fit the estimates" in each]
    assert len(misfits) == bool(said)
    assert said in "".join(misfits)


def test_a_dataset_says_how_many_agents_and_steps_there_are(tmp_path):
    scenario = scenario_of(write(tmp_path))
    assert scenario.count == 2
    assert scenario.length == 5
    assert scenario.agents.positions == ((0.0, 0.0, 1.0), (4.0, 0.0, 1.0))
    assert scenario.agents.labels == ("3", "7")
    check(Plan(scenario))


def test_values_for_each_anchor_are_counted_against_the_anchors(tmp_path):
    folder = write(tmp_path)
    assert scenario_of(folder, "sensor.bias=[0.1, 0.2]").sensor.bias == (0.1, 0.2)
    with pytest.raises(UserError, match=r"sensor\.bias lists 3 values for 2 agents"):
        scenario_of(folder, "sensor.bias=[1, 2, 3]")


def test_a_path_starts_from_the_scenarios_folder(tmp_path):
    write(tmp_path / "set")
    path = tmp_path / "mine.toml"
    path.write_text('[target]\nmotion = "dataset"\npath = "set"\n')
    assert load(str(path)).scenario.target.path == str(tmp_path / "set")


def test_more_steps_than_the_ranges_fill_and_moving_anchors_are_refused(tmp_path):
    folder = write(tmp_path)
    with pytest.raises(UserError, match=r"steps = 6, but .* fills only 5 steps of 0\.1 s; lower it"):
        scenario_of(folder, "steps=6")
    assert scenario_of(folder, "steps=4").length == 4
    with pytest.raises(UserError, match=r"agents\.motion must be 'static' for target\.motion = 'dataset'"):
        scenario_of(folder, "agents.motion=formation")


def test_recorded_ranges_reach_the_agents_with_their_age(tmp_path):
    scenario = scenario_of(write(tmp_path))
    world = make_world(scenario)
    heard = heard_in(Plan(scenario), world)
    expected = [[1.0, np.nan, 3.0, 4.0, np.nan], [np.nan, 2.0, np.nan, np.nan, 5.0]]
    np.testing.assert_allclose(heard.ranges, expected, atol=1e-6)
    ages = np.array([[0.0, 0.0, 0.0, 0.05, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0]])
    np.testing.assert_allclose(heard.age, ages, atol=1e-9)
    np.testing.assert_allclose(world.truth[0], [1.0, 2.0, 1.0, 1.0, 2.0, 0.0], atol=1e-9)


def test_the_initial_estimate_is_the_middle_of_the_anchors_at_rest(tmp_path):
    scenario = scenario_of(write(tmp_path), "filter.initial_position_std=3")
    assert Plan(scenario).initial_states.tolist() == [[2.0, 0.0, 1.0, 0.0, 0.0, 0.0]] * 2
    assert initial_std(scenario)[0] == 3.0


def test_a_first_fix_is_sought_farther_off_than_a_given_start(tmp_path):
    folder = write(tmp_path)
    sought, given = (scenario_of(folder, *more) for more in ([], ["filter.initial_position=[1, 1, 1]"]))
    # Half a diagonal is 2 m; tracking.toml gives 1 m and 0.5 m/s.
    np.testing.assert_allclose(np.sqrt(np.diag(Plan(sought).initial_covariance)), [20.0] * 3 + [3.0] * 3)
    np.testing.assert_allclose(np.sqrt(np.diag(Plan(given).initial_covariance)), [1.0] * 3 + [0.5] * 3)
    assert [Plan(one).settings.first_fix for one in (sought, given)] == [20, 20]
    for more in ("filter.start=given", "filter.defaults=1"):
        kept = Plan(scenario_of(folder, "filter.initial_position=[1, 1, 1]", more))
        assert (kept.settings.first_fix, kept.settings.search) == (0, None)
    assert Plan(scenario_of(folder, "dt=0.03")).settings.first_fix == 34


def test_what_is_assumed_of_recorded_ranges(tmp_path):
    folder = write(tmp_path)
    assert Plan(scenario_of(folder)).settings.power == 2
    for unknown in ("filter.range_std=auto", "filter.bias=none", "filter.kind=ci"):
        settings = Plan(scenario_of(folder, unknown)).settings
        assert (settings.power, settings.distrusts) == (2, True)
        wary = unknown != "filter.range_std=auto"
        settings = Plan(scenario_of(folder, unknown, "filter.defaults=3")).settings
        assert (settings.power, settings.distrusts) == ((2, True) if wary else (1, False))
        assert Plan(scenario_of(folder, unknown, "filter.defaults=1")).settings.power == 1
    assert Plan(scenario_of(folder, "dt=0.2")).motion.acceleration_std == pytest.approx(0.5**0.5)


@pytest.mark.parametrize(("interval", "least"), [(0.025, 2.0), (0.2, 0.5**0.5), (10.0, 0.5)])
def test_a_target_that_seems_calm_may_turn_as_a_person_does_however_rare_its_ranges_are(tmp_path, interval, least):
    rows = [f"{interval * step:.3f},{anchor},3.0" for step in range(6) for anchor in (3, 7)]
    folder = write(tmp_path, ranges="\n".join(["t,anchor_id,range", *rows]), truth=None)
    assert scenario_of(folder).filter.acceleration_std == pytest.approx(least)
    assert scenario_of(folder, "filter.defaults=15").filter.acceleration_std == 1.0


RECORDED = Path(__file__).resolve().parents[3] / "shared" / "data"


SETS = {
    "lias_fast": (8, 21575, 0.97, 0.04),
    "adip_los_B4": (4, 7249, 1.0, 0.1),
    "plaza2": (4, 1816, 0.0, 0.25),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_recorded_sets_use_almost_all_of_their_ranges(name):
    if not (RECORDED / name).is_dir():
        pytest.skip(f"the recorded set {name} is not beside the repository, in ../shared/data")
    agents, count, height, dt = SETS[name]
    dataset = read_dataset(RECORDED / name)
    assert dataset.anchors.shape == (agents, 3)
    assert len(dataset.ranges) == count
    overrides = [
        f"dt={dt}",
        f"filter.planar_height={height}",
        "filter.acceleration_std=1.0",
        "sensor.range_std=0.3",
    ]
    scenario = scenario_of(RECORDED / name, *overrides)
    check(Plan(scenario))
    world = make_world(scenario)
    assert world.truth.shape == (scenario.length, 6)
    assert np.isfinite(world.emitted).sum() > 0.99 * count
    assert np.isfinite(world.truth).all()
    [trace] = simulate([scenario.changed(steps=80)])
    assert np.isfinite(trace.estimates).all()
    assert (trace.estimates[:, :, 2] == height).all()


def recorded(folder, truth):
    """Forty steps of ranges of a target at rest; truth: times at which its place is known, s."""
    rows = "".join(f"{0.1 * step:.1f},{(3, 7)[step % 2]},2.0\n" for step in range(40))
    places = "".join(f"{time:.3f},1,1,1\n" for time in truth)
    write(folder, ranges="t,anchor_id,range\n" + rows, truth="t,x,y,z\n" + places)
    return ["target.motion=dataset", f'target.path="{folder}"', "network.graph=complete", "dt=0.1"]


def test_only_steps_of_which_the_truth_is_known_are_scored(tmp_path):
    scenario = load("tracking", recorded(tmp_path / "set", np.arange(0.0, 1.01, 0.05))).scenario
    [trace] = simulate([scenario])
    known = np.asarray(np.isfinite(trace.truth).all(axis=1))
    assert known.tolist() == [step <= 11 for step in range(1, 41)], "step 1 ends at the first range, at 0 s"
    assert trace.truth[known, 3:] == pytest.approx(0.0), "at the ends of the truth, too, velocities are whole"
    metrics = analyze([trace])[0].metrics
    assert metrics.scored.steps == [[3, 11]]
    assert metrics.ratio_to_centralized is not None
    assert "the truth is not known in steps 12 to 40" in metrics.lacks[0]
    assert any("covers 11 of 40 steps" in warning for warning in check(Plan(scenario)))
    told = design(Plan(scenario), search=False).centralized
    assert told is not None
    assert np.isfinite(told.position_rmse)


def test_a_gap_in_the_truth_is_not_bridged(tmp_path):
    times = [time for time in np.arange(0.0, 4.01, 0.05) if not 1.0 < time < 3.0]
    [trace] = simulate([load("tracking", recorded(tmp_path / "set", times)).scenario])
    known = np.asarray(np.isfinite(trace.truth).all(axis=1))
    assert not known[12:29].any()
    assert known[:10].all()
    assert known[32:].all()


@pytest.mark.parametrize("shift", [1.7e9, 5.0])
def test_a_truth_on_another_clock_is_refused(tmp_path, shift):
    with pytest.raises(UserError, match=r"truth\.csv has no position in the 40 steps .* bring both to one clock"):
        load("tracking", recorded(tmp_path / "set", shift + np.arange(0.0, 4.0, 0.05)))


@pytest.mark.parametrize(("unit_of_anchors", "unit_of_ranges"), [(1000.0, 1.0), (1.0, 1000.0)])
def test_anchors_and_ranges_in_different_units_are_refused(tmp_path, unit_of_anchors, unit_of_ranges):
    corners = [(0.0, 0.0), (9.0, 0.0), (9.0, 7.0), (0.0, 7.0)]
    walk = [(2.0 + 0.01 * k, 3.0) for k in range(80)]
    ranges = [math.dist(corners[k % 4], place) * unit_of_ranges for k, place in enumerate(walk)]
    anchors = "".join(f"{i},{x * unit_of_anchors},{y * unit_of_anchors},0\n" for i, (x, y) in enumerate(corners))
    rows = "".join(f"{0.1 * k:.1f},{k % 4},{value:.6f}\n" for k, value in enumerate(ranges))
    made = {"anchors": "id,x,y,z\n" + anchors, "ranges": "t,anchor_id,range\n" + rows}
    with pytest.raises(UserError, match=r"times too (far|much) .* look like millimetres; import them with --unit"):
        read_dataset(write(tmp_path, **made))


def test_a_recording_that_fills_too_many_steps_is_refused_with_the_time_that_makes_it_so(tmp_path):
    rows = "".join(f"{10.0 + 0.1 * number:.1f},3,5.0\n" for number in range(150))
    folder = write(tmp_path, ranges=f"t,anchor_id,range\n{rows}5e9,3,5.0\n")
    with pytest.raises(UserError, match="more than 10000000: 1 range at t = 5000000000 s far from all others"):
        scenario_of(folder)


def test_a_network_that_loses_its_target_at_times_is_not_taken_for_a_wrong_truth():
    (trace,) = simulate([load("lawnmower", ["steps=150"]).scenario])
    lost = trace.estimates.copy()
    lost[:, 60:100, :2] += 300.0
    said = notes(analyze([replace(trace, estimates=lost)])[0].metrics)
    assert [one for one in said if one.startswith("the network lost its target at times: NEES is")]
    said = notes(analyze([replace(trace, truth=trace.truth + 100.0)])[0].metrics)
    assert [one for one in said if one.startswith(TRUTH)]
