"""What filters assume of a recorded target's motion, where the scenario leaves that to its ranges."""

from __future__ import annotations

import numpy as np
import pytest

from tests.datasets.made import write
from zenoh_cbef.datasets import read_dataset
from zenoh_cbef.datasets.agility import agility
from zenoh_cbef.datasets.speed import speed
from zenoh_cbef.datasets.spikes import without_spikes
from zenoh_cbef.scenario import recorded_motion
from zenoh_cbef.scenario.load import load, parse

INTERVAL = 0.1


@pytest.fixture(scope="module")
def fast(tmp_path_factory):
    """Of a target that swings within a few metres, two anchors with ten ranges a second each."""
    return swinging(tmp_path_factory.mktemp("fast") / "set", 5.0)


def swinging(folder, size, every=INTERVAL):
    rows = [f"{t:.2f},{anchor},{20 + size * (np.sin(t) + np.cos(1.3 * t) * anchor / 5.0):.5f}\n"
            for t in np.arange(0.0, 600.0 * every, every) for anchor in (3, 7)]  # fmt: skip
    return write(folder, ranges="t,anchor_id,range\n" + "".join(rows), truth=None)


def assumed(folder, *more):
    told = ["target.motion=dataset", f'target.path="{folder}"', *more]
    return load("tracking", told).scenario.filter


def test_acceleration_is_what_ranges_tell(fast):
    found = agility(read_dataset(fast))
    assert found is not None
    assert found > 1.0
    assert assumed(fast, "filter.defaults=20").acceleration_std == found
    told = agility(without_spikes(read_dataset(fast)))
    assert assumed(fast).acceleration_std == told == pytest.approx(found, rel=0.01)
    assert assumed(fast, "filter.defaults=14").acceleration_std is None
    assert assumed(fast, "filter.acceleration_std=2.0").acceleration_std == 2.0


def test_a_velocity_is_forgotten_as_soon_as_speed_and_acceleration_say(fast):
    plain = without_spikes(read_dataset(fast))
    along, told = speed(plain), agility(plain)
    assert along is not None
    assert told is not None
    assert assumed(fast).velocity_time == pytest.approx(2.0 * along**2 / (told**2 * INTERVAL))
    assert 1.0 < assumed(fast).velocity_time < 10.0
    assert assumed(fast, "filter.velocity_time=7.0").velocity_time == 7.0
    assert assumed(fast, "filter.defaults=22").velocity_time == 10.0
    assert assumed(fast, "filter.acceleration_std=2.0").velocity_time == 10.0


def test_no_target_is_calmer_than_one_that_forgets_its_velocity_in_ten_seconds():
    found = assumed("recorded:lawnmower", "filter.acceleration_interval=0.0001")
    assert found.velocity_time == 10.0
    found = assumed("recorded:lawnmower", "filter.range_std=1.5")
    assert found.velocity_time == pytest.approx(10.0, rel=0.01)
    assert found.acceleration_std == pytest.approx(0.319, abs=1e-3)
    by_rules = [assumed("recorded:lawnmower", "filter.range_std=1.5", f"filter.defaults={n}") for n in (23, 15)]
    assert [one.acceleration_std for one in by_rules] == [0.5, 1.0]


def test_what_hardly_turns_may_still_do_so_within_ten_seconds(tmp_path):
    """To and fro at 3 m/s along the line to its anchors, a turn in 20 s: a median sees none."""
    rows = [
        f"{t:.2f},{anchor},{30 + 3 * abs(t % 40 - 20):.5f}\n" for t in np.arange(0.0, 80.0, 0.1) for anchor in (3, 7)
    ]
    found = assumed(write(tmp_path / "straight", ranges="t,anchor_id,range\n" + "".join(rows), truth=None))
    assert found.velocity_time == pytest.approx(10.0)
    assert found.acceleration_std == pytest.approx(np.sqrt(2.0 * 3.0**2 / 10.0 / INTERVAL), rel=0.02)


def test_a_slow_target_has_less_than_half_of_a_persons_acceleration(tmp_path):
    slow = swinging(tmp_path / "slow", 0.02)
    along = speed(without_spikes(read_dataset(slow)))
    assert along is not None
    assert along < 0.05
    found = assumed(slow, "filter.range_std=0.01", "filter.defaults=23")
    power = max(agility(without_spikes(read_dataset(slow))) or 0.0, 0.0) ** 2 * INTERVAL
    least = max(power, 2.0 * along**2 / 10.0)
    assert found.acceleration_std == pytest.approx(max(np.sqrt(least / INTERVAL), 0.5 * np.sqrt(2.0) * along), rel=0.01)
    assert found.acceleration_std < 0.1
    assert assumed(slow, "filter.range_std=0.01").acceleration_std == pytest.approx(np.sqrt(least / INTERVAL), rel=0.01)
    assert assumed(slow, "filter.range_std=0.01", "filter.defaults=22").acceleration_std == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("keys", "most"),
    [(("filter.range_std=0.3",), 0.6), (("sensor.range_std=0.2",), 0.4)],
)
def test_a_told_noise_may_be_half_of_the_true_one(fast, monkeypatch, keys, most):
    told: list[float] = []

    def spied(plain, noise):
        told.append(noise)
        return speed(plain, noise)

    monkeypatch.setattr(recorded_motion, "speed", spied)
    assumed(fast, *keys)
    assert told == [pytest.approx(most)]


def test_a_log_keeps_what_ranges_told(fast):
    found = load("tracking", ["target.motion=dataset", f'target.path="{fast}"']).scenario
    again = parse(found.model_dump(by_alias=True), "a log")
    assert again.filter == found.filter


def test_rare_ranges_make_no_target_agile(tmp_path):
    """Away from its anchors at 0.6 m/s, a range of each in 1.4 s: a walker who turns between any two would be agile."""
    rows = [f"{t:.2f},{anchor},{20 + 0.6 * t:.5f}\n" for t in np.arange(0.0, 84.0, 1.4) for anchor in (3, 7)]
    rare = write(tmp_path / "rare", ranges="t,anchor_id,range\n" + "".join(rows), truth=None)
    power = 2.0 * 0.6**2 / 10.0
    assert assumed(rare, "filter.range_std=0.05").acceleration_std == pytest.approx(np.sqrt(power / 1.4), rel=0.01)
    found = assumed(rare, "filter.range_std=0.05", "filter.defaults=23").acceleration_std
    assert found == pytest.approx(0.5 * np.sqrt(2.0) * 0.6, rel=0.01)
