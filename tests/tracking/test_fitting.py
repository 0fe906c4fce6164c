"""A range that the network's estimate denies counts for less in the next step, where no prediction denies it."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import Heard, heard_in, simulate

CIRCLE = ("dt=1", "target.motion=circle", "target.radius=5", "target.period=8", "agents.count=14", "seed=1001")


def errors(rules, wrong):
    """Position errors of all agents in steps 36 to 45, and claimed ones, m; ranges of two agents are wrong from 30."""
    plan = Plan(load("tracking", [*CIRCLE, "steps=45", f"filter.defaults={rules}"]).scenario)
    heard = heard_in(plan, make_world(plan.scenario))
    ranges = heard.ranges.copy()
    ranges[[0, 13], 30:] += wrong
    (trace,) = simulate([plan.scenario], heard=[Heard(heard.positions, ranges, heard.age)])
    off = np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2)
    claimed = np.sqrt(trace.covariances[:, :, range(3), range(3)].sum(axis=2))
    return off[:, 35:], claimed[:, 35:]


@pytest.mark.parametrize(("rules", "most"), [(15, np.inf), (16, 0.3)])
def test_two_wrong_receivers_of_fourteen_mislead_the_network_for_a_step(rules, most):
    off, claimed = errors(rules, 10.0)
    assert off.max() < most
    assert (off > 5.0 * claimed).any() == (rules == 15)


def test_good_ranges_lose_nothing():
    assert np.sqrt((errors(16, 0.0)[0] ** 2).mean()) < 1.03 * np.sqrt((errors(15, 0.0)[0] ** 2).mean())
