"""An agent that was alone does not pull the network that it meets again to where it has drifted."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.filters.around.returning import Returning, bend
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours, own_range

CORNERS = (
    "agents.count=5",
    "filter.reacquire=false",
    'fault=[{kind="crash",agents=[1,2],from=5.0,until=9.0}]',
    "target.motion=waypoints",
    "target.speed=8",
    "target.waypoints=[[-9,0,0],[0,9,2],[9,0,0],[0,-9,2],[-9,0,0]]",
    "seed=1013",
    "steps=105",
)


@pytest.mark.parametrize(("rules", "least", "most"), [(3, 5.0, np.inf), (4, 0.0, 0.3)])
def test_a_network_that_was_in_pieces_is_whole_again_at_once(rules, least, most):
    # Two agents are away, and one of the other three has no link meanwhile. Its estimate is 18 m off.
    (trace,) = simulate([load("tracking", (*CORNERS, f"filter.defaults={rules}")).scenario])
    errors = np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2)
    assert errors[3, 88] > 10.0
    assert least < errors[:, -1].max() < most


@pytest.mark.parametrize("height", [None, 1.0])
def test_the_bend_is_the_variance_of_what_linearising_leaves_out(height):
    space, random = Space(height), np.random.default_rng(2)
    size = 2 * space.axes
    root = 0.1 * random.normal(size=(size, size))
    belief = Belief(np.array([[6.0, -3.0, 2.0, 1.0, 0.5, 0.2][:size]]), (root @ root.T)[None])
    away = random.multivariate_normal(np.zeros(size), root @ root.T, 100_000)
    place = np.zeros((1, 3))
    there = Measurement(place, np.zeros(1), np.zeros(1), *no_neighbours(1))
    ranges, row = own_range(space, belief.state, place, np.zeros(1))
    every, _ = own_range(space, belief.state + away, np.zeros((len(away), 3)), np.zeros(len(away)))
    left = every - ranges[0] - away @ row[0]
    np.testing.assert_allclose(bend(space, belief, there), left.var(), rtol=0.05)


def test_it_stands_around_filters_of_a_network_that_linearise_each_for_itself():
    def names(*keys):
        found: list[object] = [Plan(load("tracking", keys).scenario).filter]
        while (inner := getattr(found[-1], "filter", None)) is not None:
            found.append(inner)
        return [type(one) for one in found]

    assert Returning in names("filter.start=given")
    for keys in (("filter.kind=ci",), ("consensus.rounds=0",), ("filter.linearise=after",), ("filter.defaults=3",)):
        assert Returning not in names("filter.start=given", *keys)
