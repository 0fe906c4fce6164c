"""Where too few agents hear the target to find it, the network does not say that it tracks it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters.around.hearers import Hearers
from zenoh_cbef.tracking.status import COASTING, LOST, TRACKING

SILENT = 70
"""The step after which some agents hear no more."""


def plan(*keys):
    return Plan(load("tracking", keys).scenario)


def run(silent, *more):
    fault = f'fault=[{{kind="sensor-dropout",probability=1.0,agents={silent},from={0.1 * SILENT}}}]'
    (trace,) = simulate([load("tracking", [fault, "steps=130", *more]).scenario])
    return trace


@pytest.mark.parametrize(("silent", "said"), [([0, 1, 2], TRACKING), ([0, 1, 2, 3], COASTING)])
def test_two_of_six_agents_do_not_find_a_target_in_space_and_three_do(silent, said):
    status = run(silent).diagnostics.status
    assert (status[:, SILENT - 5 : SILENT] == TRACKING).all()
    assert (status[:, -20:] == said).all()


MANY = [(14, range(12), ()), (14, range(12), ("consensus.rounds=2",)), (6, range(4), ("consensus.trigger=0.1",))]


@pytest.mark.slow
@pytest.mark.parametrize(("count", "silent", "more"), MANY)
def test_many_agents_or_such_as_keep_silent_know_of_how_few_the_target_is_heard(count, silent, more):
    def said(*also, silent=silent):
        return run([*silent], f"agents.count={count}", *more, *also).diagnostics.status[:, -20:]

    assert (said() == COASTING).all()
    assert (said(silent=[*silent][1:]) == TRACKING).all()
    assert (said("filter.defaults=14") == TRACKING).any()


def test_many_agents_count_by_one_number_and_agree_though_a_step_has_few_rounds():
    count, ring = 20, np.eye(20) / 3.0
    ring = ring + np.roll(ring, 1, axis=0) + np.roll(ring, -1, axis=0)
    counts = Hearers(replace(plan(f"agents.count={count}", "sensor.reach=9").settings, calls_roll=False))
    rounds = np.linalg.matrix_power(ring, 4)
    assert counts.numbers == 1
    memory: tuple[Floats, ...] = ()
    for hear, steps in ((15, 100), (2, 200), (5, 200)):
        lately = np.arange(count) < hear
        for _ in range(steps):
            averaged = rounds @ counts.told(memory, None, lately)
            memory = counts.memory(averaged, lately)
        assert ((counts.count(averaged) > 2.5) == (hear > 2.5)).all()


def test_two_agents_find_it_in_a_plane():
    plane = "filter.planar_height=0", "target.position=[1,2,0]", "target.velocity=[0.1,0,0]"
    assert (run([0, 1, 2, 3], *plane, "target.acceleration_std=0.01").diagnostics.status[:, -20:] == TRACKING).all()


def test_what_agents_say_of_it_changes_no_estimate():
    now, before = (run([0, 1, 2, 3], f"filter.defaults={rules}") for rules in (14, 13))
    assert (before.diagnostics.status[:, -1] == TRACKING).any()
    np.testing.assert_array_equal(now.estimates, before.estimates)


def test_a_target_that_leaves_the_reach_of_receivers_is_coasted_after_before_none_hears_it():
    (trace,) = simulate([load("tracking", ["sensor.reach=9", "seed=4001", "steps=175"]).scenario])
    heard = np.isfinite(trace.ranges).sum(axis=0)
    assert heard[-20:].tolist() == [1] * 20
    assert (trace.diagnostics.status[:, -20:] == COASTING).all()


def seen(seed, steps, *more):
    """Errors, m, and what agents say, of a target that goes out of reach."""
    keys = "sensor.reach=9", "consensus.trigger=0.1", f"seed={seed}", f"steps={steps}"
    (trace,) = simulate([load("tracking", [*keys, *more]).scenario])
    return np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2), trace.diagnostics.status


def test_three_that_hear_the_target_after_two_did_may_follow_its_mirror_image_and_say_so():
    error, status = seen(1047, 120, "filter.defaults=15")
    assert (error[:, 100:] > 3.0).all()
    assert (status[:, 100:] == TRACKING).all()
    assert not (seen(1047, 120)[1] == TRACKING).any()


@pytest.mark.slow
def test_a_fourth_that_denies_the_mirror_image_makes_the_network_look_for_its_target_again():
    error, status = seen(6014, 296)
    assert (error[:, 240:280] > 5.0).all()
    assert (status[:, 260:280] == LOST).all()
    assert not (status == TRACKING).any()
    assert error[:, -1].max() < 0.5


@pytest.mark.slow
def test_ranges_of_two_hearers_do_not_pull_the_estimate_along_their_circle():
    now, before = (seen(1037, 120, *more)[0][0] for more in ((), ("filter.defaults=15",)))
    assert now[-1] < 0.5 * before[-1]
