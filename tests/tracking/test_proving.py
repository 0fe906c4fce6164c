"""After a silence of real ranges: what another fix is made of, and what proves the place that it finds."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from zenoh_cbef.scenario.filtering import Filtering
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import Heard, heard_in, simulate
from zenoh_cbef.tracking.filters.finding.first_fix import FirstFix
from zenoh_cbef.tracking.filters.finding.proving import fitting
from zenoh_cbef.tracking.filters.finding.squared_ranges import Seen
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Space
from zenoh_cbef.tracking.status import ACQUIRING, LOST, TRACKING, Status

AXES, FIX = 2, 0


def after(status: Status, *, fits: bool, proves: bool) -> Status:
    """A step later, in which one range of an agent whose ranges fit, or do not, was heard."""
    one = np.ones(1)
    told = {"heard": one, "misfit": 9.0 * (not fits) * one, "spread": one, "most": 0.9}
    return status.after(axes=AXES, fix=FIX, dt=0.1, proves=proves, **told)  # type: ignore[arg-type]


@pytest.mark.parametrize(("proves", "needed"), [(True, 20), (False, 4)])
def test_a_place_that_was_lost_before_it_was_proved_has_to_be_proved(proves, needed):
    status, said = Status.first(1), []
    for step in range(40):
        status = after(status, fits=step > 0, proves=proves)
        said.append(float(status.which[0]))
    assert said[0] == LOST
    first = said.index(TRACKING)
    assert first >= needed
    assert set(said[:first]) == ({LOST, ACQUIRING} if proves else {LOST})


def test_a_network_of_few_agents_does_not_begin_as_one_that_has_lost_its_target():
    said = [after(Status.first(1, proves=proves), fits=True, proves=proves).which.tolist() for proves in (True, False)]
    assert said == [[ACQUIRING], [LOST]]


def test_ranges_that_fit_another_fix_prove_it_as_later_ones_do():
    begun = Status.first(1).anew(np.array([True]), fitted=np.array([15.0]))
    assert (begun.heard[0], begun.which[0]) == (15.0, ACQUIRING)
    for step in range(5):
        begun = after(begun, fits=True, proves=True)
        assert begun.which[0] == (TRACKING if step == 4 else ACQUIRING)
    # By earlier rules they count for nothing.
    assert Status.first(1).anew(np.array([True])).heard[0] == 0.0


def test_ranges_fit_a_fix_that_are_off_by_less_than_three_deviations_of_noise_and_motion():
    motion = NearlyConstantVelocity(0.1, 1.0)
    settings = FilterSettings(motion=motion, space=Space(), range_std=0.1, network_size=4, xi=2.0)
    fix = FirstFix.of(settings, None, 2.0, 35)  # type: ignore[arg-type]
    state = np.array([[3.0, 4.0, 0.0, 0.0, 0.0, 0.0]])
    ages = np.array([[0.0, 0.0, 0.0, 3.0, 3.0]])
    wandered = np.sqrt(0.01 + 0.1 * 3.0**3 / 3.0)
    off = np.array([[0.29, -0.31, np.nan, 2.9 * wandered, 3.1 * wandered]])
    seen = Seen(np.zeros((1, 5, 3)), ages, 5.0 + off)
    assert fitting(fix, state, seen).tolist() == [2.0]


@pytest.mark.parametrize(("scenario", "rules", "proves"), [
    ("lawnmower", 16, True), ("lawnmower", 15, False), ("tracking", 16, False)
])  # fmt: skip
def test_so_it_is_where_ranges_are_real(scenario, rules, proves):
    assert Filtering(load(scenario, [f"filter.defaults={rules}"]).scenario).settings.proves is proves


@cache
def silent(rules: int):
    """`lawnmower`, of which a minute is missing, and when the silence ends, s."""
    keys = f"filter.defaults={rules}", "steps=320"
    scenario = load("lawnmower", keys).scenario
    world = make_world(scenario)
    heard = heard_in(Plan(scenario), world)
    quiet = (world.time > 60.0) & (world.time <= 120.0)
    cut = Heard(heard.positions, np.where(quiet, np.nan, heard.ranges), heard.age)
    return simulate([scenario], heard=[cut])[0]


@pytest.mark.slow
def test_none_says_that_it_tracks_where_it_is_far_off():
    trace = silent(16)
    off = np.linalg.norm((trace.estimates - trace.truth)[:, :, :2], axis=2)
    claimed = np.sqrt(np.trace(trace.covariances[:, :, :2, :2], axis1=2, axis2=3))
    says = trace.diagnostics.status == TRACKING
    assert says[:, trace.time > 140.0].any()
    assert (off[says] < 4.0 * claimed[says]).all()
