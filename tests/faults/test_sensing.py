"""Faults of sensors change what the faulty agents measure while they are on, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.faults import SensorStuck, measured_ranges
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.world import make_world

SPEED = 299_792_458.0
COUNT, STEPS = 4, 50


def ranges(*faults, seed=3, steps=STEPS, **sensor):
    scenario = {"seed": seed, "steps": steps, "agents": {"count": COUNT}, "fault": list(faults), "sensor": sensor}
    world = make_world(parse(scenario, "test"))
    return SPEED * (world.arrived - world.emitted)


def assert_near(actual, expected):
    # Times of flight are differences of run times, which resolve about a micrometre.
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-5)


def test_bias_is_added_to_the_agents_it_names_while_it_is_on():
    faulty = ranges({"kind": "sensor-bias", "bias": -0.7, "agents": [1, 3], "from": 1.0, "until": 2.05})
    expected = ranges()
    expected[[1, 3], 9:20] -= 0.7
    assert_near(faulty, expected)


def test_a_stuck_sensor_repeats_its_last_range_and_hears_no_more_than_before():
    clean = ranges(dropout_probability=0.4)
    faulty = ranges({"kind": "sensor-stuck", "agents": [0, 2], "from": 2.0, "until": 4.0}, dropout_probability=0.4)
    expected = clean.copy()
    for agent in (0, 2):
        before = [value for value in clean[agent, :19] if np.isfinite(value)]
        for k in range(19, 39):
            if np.isfinite(clean[agent, k]):
                expected[agent, k] = before[-1]
    assert_near(faulty, expected)
    assert np.isnan(faulty).sum() == np.isnan(clean).sum() > 20


def test_a_sensor_that_is_stuck_from_the_beginning_repeats_its_first_range():
    clean, faulty = ranges(), ranges({"kind": "sensor-stuck"})
    assert_near(faulty, np.repeat(clean[:, :1], STEPS, axis=1))


def test_a_sensor_is_stuck_at_the_first_range_that_it_hears_where_it_heard_none_before():
    heard = np.array([[np.nan, 5.0, np.nan, 6.0, 7.0]])
    stuck = SensorStuck(kind="sensor-stuck", until=3.5)
    told = measured_ranges([stuck], heard, seed=1, time=np.arange(5.0), signal_speed=SPEED)
    np.testing.assert_array_equal(told, [[np.nan, 5.0, np.nan, 5.0, 7.0]])


def test_dropouts_have_their_probability_and_leave_the_rest():
    clean, faulty = ranges(steps=5000), ranges({"kind": "sensor-dropout", "probability": 0.2}, steps=5000)
    missing = np.isnan(faulty)
    assert abs(missing.mean() - 0.2) < 6 * np.sqrt(0.16 / missing.size)
    assert faulty[~missing].tobytes() == clean[~missing].tobytes()
    assert np.isnan(ranges({"kind": "sensor-dropout", "agents": [1]})).sum() == STEPS


def test_spikes_are_rare_normal_and_of_either_sign():
    added = ranges({"kind": "sensor-spikes", "probability": 0.1, "std": 4.0}, steps=5000) - ranges(steps=5000)
    hit = np.abs(added) > 1e-4
    assert abs(hit.mean() - 0.1) < 6 * np.sqrt(0.09 / hit.size)
    sizes = added[hit]
    assert abs(sizes.mean()) < 6 * 4.0 / np.sqrt(len(sizes))
    assert abs(sizes.std() - 4.0) < 6 * 4.0 / np.sqrt(2 * len(sizes))


def test_a_clock_turns_its_error_into_range_error():
    faulty = ranges({"kind": "clock", "agents": [2], "offset": 1e-8, "drift": -2e-9, "from": 1.0})
    expected = ranges()
    for k in range(9, STEPS):
        expected[2, k] += SPEED * (1e-8 - 2e-9 * (0.1 * (k + 1) - 1.0))
    assert_near(faulty, expected)
    assert abs(faulty[2, 9] - ranges()[2, 9] - 2.998) < 0.01


def test_faults_act_one_after_the_other():
    bias, stuck = {"kind": "sensor-bias", "bias": 2.0}, {"kind": "sensor-stuck", "from": 1.0}
    clean = ranges()
    assert_near(ranges(bias, stuck)[:, 20], clean[:, 8] + 2.0)
    assert_near(ranges(stuck, bias)[:, 20], clean[:, 8] + 2.0)
    late = {**bias, "from": 1.5}
    assert_near(ranges(stuck, late)[:, 20], clean[:, 8] + 2.0)
    assert_near(ranges(late, stuck)[:, 20], clean[:, 8])


@pytest.mark.parametrize("kind", ["sensor-spikes", "sensor-dropout"])
def test_draws_of_agents_steps_seeds_and_faults_are_independent(kind):
    fault = {"kind": kind, "probability": 0.5}

    def struck(*faults, seed):
        changed = ranges(*faults, seed=seed, steps=4000)
        return ~np.isclose(changed, ranges(seed=seed, steps=4000), atol=1e-4)

    first, other = struck(fault, seed=3), struck(fault, seed=4)
    second = struck({**fault, "probability": 0.0}, fault, seed=3)
    draws = np.array([*first, *other, *second, first[0, ::-1]], dtype=float)
    correlation = np.corrcoef(draws) - np.eye(len(draws))
    assert np.abs(correlation).max() < 6 / np.sqrt(4000)


def test_recorded_ranges_are_struck_as_emulated_ones_are(tmp_path):
    times = np.arange(0.05, 3.0, 0.1)
    (tmp_path / "anchors.csv").write_text("id,x,y,z\n0,0,0,0\n1,4,0,0\n2,0,4,0\n")
    rows = [f"{at},{anchor},{2.0 + anchor + at}" for at in times for anchor in range(3)]
    (tmp_path / "ranges.csv").write_text("\n".join(["t,anchor_id,range", *rows]) + "\n")
    (tmp_path / "truth.csv").write_text("t,x,y,z\n" + "".join(f"{at},1,1,1\n" for at in times))
    scenario = tmp_path / "s.toml"
    scenario.write_text('target = {motion = "dataset", path = "."}\n')
    fault = 'fault=[{kind="sensor-bias", bias=1.5, agents=[1], from=1.0}]'
    clean, faulty = (make_world(load(str(scenario), given).scenario) for given in ([], [fault]))
    added = SPEED * (faulty.arrived - faulty.emitted - clean.arrived + clean.emitted)
    on = faulty.time >= 1.0
    assert np.isfinite(added).all()
    assert_near(added[1, on], np.full(on.sum(), 1.5))
    assert_near(added[1, ~on], 0.0)
    assert_near(added[[0, 2]], 0.0)


def test_no_fault_returns_the_very_ranges():
    given = np.ones((2, 3))
    assert measured_ranges([], given, seed=1, time=np.arange(3.0), signal_speed=SPEED) is given
