"""A range of zero is none where receivers may be wrong by a constant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import heard_in, simulate

NEAR = "agents.low=-3", "agents.high=3", "steps=40"
BIASED = (*NEAR, "sensor.bias_std=2", "target.radius=2", "seed=1018")


def run(keys, rules, *, drops=False):
    """A run, its receivers' ranges, m, and how many of these are zero. drops: whether those are told as none."""
    plan = Plan(load("tracking", [*keys, f"filter.defaults={rules}"]).scenario)
    world = make_world(plan.scenario)
    zero = world.arrived == world.emitted
    heard = heard_in(plan, world)
    if drops:
        heard = replace(heard, ranges=np.where(zero, np.nan, heard.ranges))
    return simulate([plan.scenario], heard=[heard])[0], heard.ranges, int(zero.sum())


@pytest.mark.parametrize(
    "more", ["target.motion=circle", "filter.planar_height=0", "agents.count=14", "filter.kind=icf"]
)
def test_what_a_receiver_cuts_off_at_zero_counts_for_nothing(more):
    today, ranges, zeros = run((*BIASED, more), 28)
    dropped, _, _ = run((*BIASED, more), 27, drops=True)
    before, cut, _ = run((*BIASED, more), 27)
    assert zeros > 5
    assert np.isnan(ranges).sum() - np.isnan(cut).sum() == zeros
    assert today.estimates.tobytes() == dropped.estimates.tobytes() != before.estimates.tobytes()


def test_a_range_of_zero_is_one_where_noise_alone_shortens_it():
    keys = (*NEAR, "sensor.range_std=1")
    _, ranges, zeros = run(keys, 28)
    assert (ranges == 0.0).sum() == zeros > 2


@pytest.mark.parametrize("seed", [1018, 1036])
def test_agents_stay_honest_beside_a_receiver_that_says_zero(seed):
    trace, _, _ = run(("sensor.bias_std=3", f"seed={seed}"), 28)
    off = (trace.estimates - trace.truth)[0][:, :3]
    claimed = trace.covariances[0][:, :3, :3]
    nees = np.einsum("ki,kij,kj->k", off, np.linalg.inv(claimed), off) / 3
    assert nees.mean() < 3.0
