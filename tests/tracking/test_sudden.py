"""A real target that rested and drives off, or turns sharply, is followed, and where it is not the network says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.datasets.made import scenario_of, write_rows
from tests.tracking.resting import AGENTS, MOTION, PLACES, STD, measured
from zenoh_cbef.scenario import trust
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.filters.around.distrusting import Distrusting
from zenoh_cbef.tracking.filters.around.recovering import Recovering
from zenoh_cbef.tracking.filters.around.sudden import Sudden
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.kinds.sicf import SaturatedInformation
from zenoh_cbef.tracking.ranging import Space
from zenoh_cbef.tracking.status import TRACKING

ANCHORS = ((0.0, 0.0), (96.0, 0.0), (96.0, 64.0), (0.0, 64.0), (48.0, 0.0))
SECONDS, RATE = 30.0, 10.0


def recording(folder, way, seed=1, *, reflects=False):
    """Ranges of five anchors, noise 0.1 m, of a target at way(t), (k, 2).

    reflects: anchor 4 reads 0.8 m too long for 5 s.
    """
    random, rows = np.random.default_rng(seed), []
    for number, anchor in enumerate(ANCHORS):
        at = random.uniform(0.0, 1.0 / RATE) + np.arange(0.0, SECONDS - 0.2, 1.0 / RATE)
        range_ = np.linalg.norm(way(at) - anchor, axis=1) + 0.1 * random.normal(size=len(at))
        range_ += 0.8 * (reflects and number == 4) * ((at > 19.5) & (at < 24.5))
        rows += [(t, number, r) for t, r in zip(at, range_, strict=True)]
    time = np.arange(0.0, SECONDS, 0.05)
    truth = [(t, x, y, 0) for t, (x, y) in zip(time, way(time), strict=True)]
    return write_rows(folder, [(*anchor, 0) for anchor in ANCHORS], rows, truth)


def drives_off(time):
    """At rest for 20 s, then 8 m/s^2 for 1.5 s, and on."""
    since = np.maximum(time - 20.0, 0.0)
    way = np.where(since < 1.5, 4.0 * since**2, 12.0 * since - 9.0)
    return np.stack([3.0 + 0.8 * way, 3.0 + 0.4 * way], axis=-1)


def turns(time):
    """At 3 m/s, and at 20 s at once at a right angle."""
    along, across = np.minimum(time, 20.0), np.maximum(time - 20.0, 0.0)
    return np.stack([5.0 + 3.0 * along, 13.0 + 3.0 * across], axis=-1)


def followed(folder, *more):
    """Errors (n, K), m, and where agents say that they track."""
    scenario = scenario_of(folder, "dt=0.1", "filter.range_std=0.1", "filter.planar_height=0", *more)
    (trace,) = simulate([scenario])
    return np.linalg.norm((trace.estimates - trace.truth)[..., :2], axis=2), trace.diagnostics.status == TRACKING


@pytest.mark.parametrize("way", [drives_off, turns])
def test_it_is_followed_and_by_earlier_rules_it_was_not(tmp_path, way):
    folder = recording(tmp_path / "set", way)
    errors, tracking = followed(folder, "filter.defaults=22")
    before, _ = followed(folder, "filter.defaults=21")
    moved = slice(195, 280)
    assert np.sqrt(np.mean(errors[:, moved] ** 2)) < 0.5 * np.sqrt(np.mean(before[:, moved] ** 2))
    assert errors[:, 40:][tracking[:, 40:]].max() < 0.7 * before[:, moved].max()
    np.testing.assert_array_equal(errors[:, 40:190], before[:, 40:190])
    # How fast the target is tells that it turns, so it is followed more closely.
    today, _ = followed(folder)
    assert np.sqrt(np.mean(today[:, moved] ** 2)) < 0.8 * np.sqrt(np.mean(errors[:, moved] ** 2))


def test_a_reflection_that_begins_at_a_corner_does_not_take_the_estimate_along(tmp_path):
    folder = recording(tmp_path / "set", turns, reflects=True)
    errors, _ = followed(folder, "filter.defaults=22")
    before, _ = followed(folder, "filter.defaults=21")
    assert errors[:, 195:].max() < 0.5 * before[:, 195:].max()


def updates(ranges, *, distrust=None, steps=2):
    """Six agents in one place of a target in the origin that is at rest, whose ranges (K, 6) are off: their updates."""
    made = Sudden(SaturatedInformation(MOTION, Space(), STD, AGENTS, 1.5), steps)
    belief = Belief(np.zeros((AGENTS, 6)), np.tile(1e-6 * np.eye(6), (AGENTS, 1, 1)))
    for seed, row in enumerate(ranges):
        update = made.update(belief, replace(measured(row, seed), distrust=distrust))
        belief = made.conclude(np.tile(update.payload.mean(axis=0), (AGENTS, 1)), update)
        yield update.payload[:, -1], belief


def test_an_agent_says_how_implausible_its_range_is_for_as_long_as_it_has_no_other():
    off = np.full((5, AGENTS), np.nan)
    off[0] = 0.0
    off[1, 0] = 10.0
    said = np.array([one for one, _ in updates(off)])
    np.testing.assert_array_equal(said[:4, 0], [-0.5, 0.5, 0.5, 0.5])
    np.testing.assert_array_equal(said[:4, 1], [-0.5, -0.5, -0.5, 0.0])


def test_it_says_neither_of_a_nis_of_five_and_all_it_can_two_from_there():
    made = Sudden(SaturatedInformation(MOTION, Space(), STD, AGENTS, 1.5), 2)
    belief = Belief(np.zeros((AGENTS, 6)), np.tile(1e-6 * np.eye(6), (AGENTS, 1, 1)))
    off = STD * np.sqrt([0.0, 3.5, 4.5, 5.5, 6.5, 20.0])
    update = made.update(belief, replace(measured(off, 0), range=np.linalg.norm(PLACES, axis=1) + off))
    np.testing.assert_allclose(update.payload[:, -1], [-0.5, -0.375, -0.125, 0.125, 0.375, 0.5], atol=0.01)


def test_an_agent_that_distrusts_its_ranges_says_nothing():
    distrust = np.array([0.2, 0.05, 0.0, 0.0, 0.0, 0.0])
    said, _ = next(updates(np.full((1, AGENTS), 10.0), distrust=distrust))
    np.testing.assert_array_equal(said, [0.0, 0.5, 0.5, 0.5, 0.5, 0.5])


@pytest.mark.parametrize(("wrong", "grows"), [(0, 1.0), (3, 1.0), (4, 2.0), (6, 2.0)])
def test_covariances_double_where_most_ranges_are_implausible_and_then_all_begin_anew(wrong, grows):
    off = np.zeros((2, AGENTS))
    off[0, :wrong] = 10.0
    off[1] = np.nan
    (_, first), (said, _) = updates(off)
    inner = Belief(np.zeros((AGENTS, 6)), np.tile(1e-6 * np.eye(6), (AGENTS, 1, 1)))
    plain = SaturatedInformation(MOTION, Space(), STD, AGENTS, 1.5)
    update = plain.update(inner, measured(off[0], 0))
    concluded = plain.conclude(np.tile(update.payload.mean(axis=0), (AGENTS, 1)), update)
    np.testing.assert_array_equal(first.covariance, grows * concluded.covariance)
    np.testing.assert_array_equal(said == 0.0, np.full(AGENTS, grows > 1.0))


@pytest.mark.parametrize(
    ("keys", "wanted"),
    [
        ([], False),
        (["sensor.real=true"], True),
        (["sensor.real=true", "filter.defaults=21"], False),
        (["sensor.real=true", "consensus.rounds=0"], False),
        (["sensor.real=true", "filter.kind=local"], False),
        (["sensor.real=true", "filter.recovery=false"], False),
        (["filter.recovery=true"], True),
    ],
)
def test_networks_with_real_ranges_recover(keys, wanted):
    assert trust.recovers(load("tracking", keys).scenario) is wanted


@pytest.mark.parametrize(("interval", "steps"), [(0.04, 1), (0.1, 1), (0.3, 3)])
def test_an_agent_is_silent_after_three_of_the_intervals_in_which_it_has_ranges(interval, steps):
    keys = ["sensor.real=true", f"filter.acceleration_interval={interval}"]
    settings = load("tracking", keys).plan.settings
    assert (settings.sudden, settings.silence) == (steps, 3 * steps)
    assert load("tracking", keys[1:]).plan.settings.silence == 0


def around(chosen):
    """The kinds of filters that stand around the innermost one, the outermost first."""
    while isinstance(chosen, Wrapping):
        yield type(chosen)
        chosen = chosen.filter


@pytest.mark.parametrize(("keys", "wanted"), [(["sensor.real=true"], Sudden), (["filter.recovery=true"], Recovering)])
def test_it_stands_in_the_place_of_recovery_where_ranges_are_real(keys, wanted):
    kinds = {*around(load("tracking", keys).plan.filter)}
    assert kinds & {Sudden, Recovering} == {wanted}


def test_an_agent_that_its_distrust_makes_doubt_its_ranges_says_nothing():
    sudden = Sudden(SaturatedInformation(MOTION, Space(), STD, AGENTS, 1.5), 2)
    made, belief = Distrusting(sudden, STD), Belief(np.zeros((AGENTS, 6)), np.tile(0.01 * np.eye(6), (AGENTS, 1, 1)))
    off = np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    for seed in range(12):
        update = made.update(belief, measured(off, seed))
        belief = made.conclude(np.tile(update.payload.mean(axis=0), (AGENTS, 1)), update)
    assert update.diagnostics.distrust[0] > 0.9
    assert update.payload[0, -2] == 0.0
    assert (update.payload[1:, -2] < 0.0).all()
