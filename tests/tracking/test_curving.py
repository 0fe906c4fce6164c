"""What linearising a range at an unsure estimate leaves out counts with its noise, where ranges are real."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from benchmarks.held_out import settings, write
from benchmarks.random_sets import drawn
from benchmarks.recorded import errors
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.filters import Belief, Filter, make_filter
from zenoh_cbef.tracking.filters.around.curving import Curving
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours

STD = 0.03
SETTINGS = replace(
    Plan(load("tracking", []).scenario).settings,
    network_size=1, range_std=STD, first_fix=0, says_status=False, reacquires=0, supposes=False, returns=False,
)  # fmt: skip


@dataclass
class Spying:
    """A filter that keeps what noise it was told."""

    filter: Filter
    told: list[float] = field(default_factory=list)

    def update(self, belief, measurement):
        self.told += np.atleast_1d(measurement.range_std).tolist()
        return self.filter.update(belief, measurement)

    def conclude(self, payload, update):
        return self.filter.conclude(payload, update)


def heard(distance):
    return Measurement(np.array([[distance, 0.0, 0.0]]), np.array([distance]), np.zeros(1), *no_neighbours(1))


def unsure(std):
    return Belief(np.zeros((1, 6)), np.diag([std**2] * 3 + [1e-12] * 3)[None])


@pytest.mark.parametrize(("distance", "std"), [(10.0, 1.0), (5.0, 0.5), (30.0, 0.01)])
def test_the_noise_is_that_of_a_range_over_the_line_that_stands_for_it(distance, std):
    spying = Spying(make_filter("sicf", SETTINGS))
    still = NearlyConstantVelocity(0.1, 0.0, 3)
    around = Curving(spying, still, SETTINGS.space, STD)
    around.update(unsure(std), heard(distance))
    places = std * np.random.default_rng(5).standard_normal((400_000, 3))
    left = np.linalg.norm(places - [distance, 0.0, 0.0], axis=1) - (distance - places[:, 0])
    assert spying.told[0] ** 2 == pytest.approx(STD**2 + np.var(left), rel=0.05)


def test_what_is_left_open_is_of_the_moment_of_the_range():
    """A velocity that is not known leaves the place open a step later, however well it is known now."""
    spying, step = Spying(make_filter("sicf", SETTINGS)), 0.5
    belief = Belief(np.zeros((1, 6)), np.diag([1e-12] * 3 + [2.0**2] * 3)[None])
    Curving(spying, NearlyConstantVelocity(step, 0.0, 3), SETTINGS.space, STD).update(belief, heard(5.0))
    assert spying.told[0] ** 2 == pytest.approx(STD**2 + 0.5 * 2 * ((2.0 * step) ** 2 / 5.0) ** 2)


def test_a_sure_estimate_has_the_range_as_it_was():
    around = make_filter("sicf", replace(SETTINGS, curves=True))
    plain = make_filter("sicf", SETTINGS)
    for std, alike in ((1e-4, True), (1.0, False)):
        first, second = (each.update(unsure(std), heard(20.0)).payload for each in (around, plain))
        assert np.allclose(first, second, rtol=1e-6) is alike


@pytest.mark.parametrize(
    ("keys", "curves"),
    [
        ({"sensor": {"real": True}}, True),
        ({"sensor": {"real": True}, "filter": {"defaults": 23}}, False),
        ({"sensor": {"real": True}, "filter": {"motion": "imm"}}, False),
        ({"sensor": {"real": True}, "filter": {"kind": "ci", "measurement": "difference"}}, False),
        ({"sensor": {"real": True}, "filter": {"kind": "kcf"}}, False),
        ({}, False),
    ],
)
def test_where_ranges_are_real_and_one_motion_follows_them(keys, curves):
    assert Plan(parse(keys, "test")).settings.curves is curves


@pytest.mark.parametrize(("seed", "before"), [(1025, 2.0), (3027, 5.0)])
def test_turns_that_seemed_wrong_ranges_no_longer_lose_the_target(tmp_path, seed, before):
    """Precise ranges: half of them missing of a target at 3 m/s, or two in a second of one that turns on the spot."""
    write(drawn(seed), seed, tmp_path / "set")
    keys = settings(drawn(seed), tmp_path / "set")
    today, former = (errors(keys | {"filter.defaults": rules})[0] for rules in (24, 23))
    assert former > before * today
