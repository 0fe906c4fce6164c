"""Agents that tell each other their ranges agree on their guesses before they predict them."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate

CIRCLE = ("dt=1", "target.motion=circle", "target.radius=5", "target.period=8", "seed=1001")


@pytest.mark.parametrize(("rules", "told"), [(15, False), (16, True)])
def test_as_many_agents_as_axes_tell_ranges_of_a_target_of_several_motions(rules, told):
    assert Plan(load("tracking", [*CIRCLE, "agents.count=3", f"filter.defaults={rules}"]).scenario).tells_ranges == told


@pytest.mark.parametrize(("rules", "agreed"), [(15, False), (16, True)])
def test_agents_of_one_network_believe_the_same_after_one_step(rules, agreed):
    # All agents are neighbours, so rounds leave the very mean of what they guess.
    sets = [*CIRCLE, "network.graph=complete", "agents.count=4", "steps=3", f"filter.defaults={rules}"]
    (trace,) = simulate([load("tracking", sets).scenario])
    assert trace.plan.tells_ranges
    assert (np.ptp(trace.covariances[:, -1], axis=0).max() < 1e-9) == agreed
