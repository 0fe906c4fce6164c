"""A network looks for a lost target soon, and a filter that has coasted too far leaves ranges to that fix."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters.finding.patience import gives_up, hears_again, left_to_a_fix
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours
from zenoh_cbef.tracking.status import COASTING, LOST, Status

WINDOW = 10
DT = 0.25


def settings_of(*overrides):
    return Plan(load("tracking", [f"dt={DT}", *overrides]).scenario).settings


def known(which, steps, latest, fitted=121.0):
    return replace(
        Status.first(1),
        heard=np.array([fitted]),
        which=np.array([which]),
        seconds=np.array([steps * DT]),
        latest=np.array([latest]),
    )


@pytest.mark.parametrize(
    ("which", "steps", "latest", "heard", "gives"),
    [
        (LOST, 4, 9.0, WINDOW, (False, False)),
        (LOST, 5, 9.0, WINDOW, (True, False)),
        (LOST, 5, 9.0, WINDOW - 1, (False, False)),
        (LOST, 29, 1.0, WINDOW, (False, False)),
        (LOST, 30, 1.0, 0, (True, True)),
        (COASTING, 40, 9.0, WINDOW, (False, False)),
    ],
)
def test_a_network_whose_ranges_do_not_fit_even_now_gives_up_soon(which, steps, latest, heard, gives):
    ranges = np.where(np.arange(2 * WINDOW) < heard, 1.0, np.nan)[None]
    status = known(which, steps, latest)
    assert gives_up(settings_of(), status, ranges).tolist() == [gives[0]]
    assert gives_up(settings_of("filter.defaults=8"), status, ranges).tolist() == [gives[1]]


@pytest.mark.parametrize(
    ("coasts", "steps", "last", "heard", "again"),
    [
        (True, 4, 5, False, False),
        (True, 4, 4, False, True),
        (True, 4, 5, True, True),
        (False, 4, 5, False, True),
    ],
    ids=["a range before", "a range since", "a range now", "it does not coast"],
)
def test_a_fix_waits_for_ranges_that_come_while_the_network_coasts(coasts, steps, last, heard, again):
    """The last range came `last` steps before this one, and the network coasts for so many steps."""
    ranges = np.full((1, 2 * WINDOW), np.nan)
    ranges[0, -last] = 1.0
    status = replace(known(COASTING, steps, 0.0), spread=np.ones(1), reference=np.array([0.1 if coasts else 1.0]))
    now, before, real, earlier = (
        hears_again(settings_of(*keys), status, ranges, np.array([heard]))
        for keys in ((), ("filter.defaults=15",), ("sensor.real=true",), ("sensor.real=true", "filter.defaults=22"))
    )
    assert (now.tolist(), before.tolist(), real.tolist(), earlier.tolist()) == ([again], [True], [again], [True])


def test_a_fix_that_did_not_help_is_not_made_again_soon():
    ranges = np.ones((1, 2 * WINDOW))
    assert gives_up(settings_of(), known(LOST, 5, 9.0, 119.0), ranges).tolist() == [False]
    assert gives_up(settings_of(), known(LOST, 30, 9.0, 119.0), ranges).tolist() == [True]


def test_of_real_receivers_nothing_is_given_up_sooner_but_a_fix_waits_for_no_window():
    assert (settings_of().prompt, settings_of().deciding) == (True, 0)
    real, before = (settings_of("sensor.real=true", f"filter.defaults={rules}") for rules in (13, 12))
    assert (real.prompt, real.deciding) == (False, real.spreading + 1)
    assert (before.prompt, before.deciding) == (False, 0)


def test_a_filter_that_is_adrift_hears_no_ranges_where_it_would_learn_biases_from_them():
    measurement = Measurement(np.zeros((2, 3)), np.array([3.0, 4.0]), np.zeros(2), *no_neighbours(2))
    rows, biased = np.array([True, False]), settings_of("sensor.bias_std=0.5")
    np.testing.assert_array_equal(left_to_a_fix(biased, measurement, rows).range, [np.nan, 4.0])
    assert left_to_a_fix(settings_of(), measurement, rows) is measurement
    assert left_to_a_fix(settings_of("sensor.bias_std=0.5", "filter.defaults=8"), measurement, rows) is measurement


@pytest.mark.slow
def test_biases_are_still_right_after_a_long_silence():
    """At twenty seconds of silence, 2.5 s after which another fix is done; largest error of all agents."""
    silence = 'fault=[{kind="sensor-dropout",probability=1.0,from=10.0,until=30.0}]'

    def errors(rules):
        keys = ["sensor.bias_std=0.5", silence, "steps=330", f"filter.defaults={rules}"]
        traces = simulate([load("tracking", [*keys, f"seed={1001 + more}"]).scenario for more in range(5)])
        return [np.linalg.norm((one.estimates - one.truth)[:, 325, :3], axis=1).max() for one in traces]

    found, before = errors(9), errors(8)
    assert np.median(found) < 0.8
    assert max(found) < 2.5
    assert max(before) > 2.5
