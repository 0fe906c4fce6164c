"""Agents near one plane do not believe their guess of the side that the target is on."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stress import cases, scenario_of
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.around.mirror_images import _cost, mirrored
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.ranging import Space, own_range
from zenoh_cbef.tracking.status import ACQUIRING, TRACKING

CASE = cases()["near-a-plane-and-mirror-guess"]
TILTED = "agents.positions=[[0,0,-0.2],[9,0,9.3],[0,8,0.2],[7,-8,6.8],[-6,5,-6.2],[-9,-3,-8.8]]"


def off(trace):
    """Position errors, m, and what agents say, both (n, K)."""
    return np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2), trace.diagnostics.status


def test_ranges_decide_the_side_and_till_then_agents_acquire():
    (trace,) = simulate([scenario_of(CASE, ["steps=120", "seed=1001"])])
    error, said = off(trace)
    assert (said[:, :20] == ACQUIRING).all()
    assert error[:, 19].min() > 3.0  # The fix believes the guess.
    assert not (said[error > 1.0] == TRACKING).any()
    assert (said[:, -1] == TRACKING).all()
    assert error[:, -1].max() < 0.5


def test_by_the_rules_before_they_were_sure_of_the_wrong_side():
    (trace,) = simulate([scenario_of(CASE, ["steps=120", "seed=1001", "filter.defaults=8"])])
    error, said = off(trace)
    assert error[:, -1].min() > 2.0
    assert (said[:, -1] == TRACKING).all()


@pytest.mark.parametrize(("rules", "squares"), [(24, True), (25, False)])
def test_agents_in_a_plane_have_one_filter(rules, squares):
    places = "agents.positions=[[-9,-7,0.02],[8,-6,-0.02],[7,8,0.02],[-6,9,-0.02],[1,-9,0.02],[-2,5,-0.02]]"
    plan = Plan(scenario_of(CASE, [places, f"filter.defaults={rules}"]))
    assert plan.plane is None
    assert plan.squares is squares


@pytest.mark.parametrize(
    ("more", "normal"),
    [
        ((), None),
        (("agents.low=[-10,-10,-0.5]", "agents.high=[10,10,0.5]"), [0, 0, 1]),
        (("agents.low=[-10,-10,-0.6]", "agents.high=[10,10,0.6]"), None),
        (("agents.low=[-10,-0.5,0]", "agents.high=[10,0.5,0]", "filter.planar_height=0"), [0, 1]),
        ((TILTED,), [0.5**0.5, 0, -(0.5**0.5)]),
        ((TILTED, "filter.defaults=8"), None),
        ((TILTED, "filter.kind=ci"), None),
        ((TILTED, "filter.recovery=true"), None),
        ((TILTED, "sensor.bias=0.5"), None),
        ((TILTED, "target.motion=circle"), None),
        ((TILTED, "agents.count=3"), None),
    ],
)
def test_where_agents_are_near_a_plane(more, normal):
    plan = Plan(load("tracking", more).scenario)
    assert (plan.plane is None) is (normal is None)
    if normal is not None and plan.plane is not None:
        assert abs(np.dot(plan.plane[1], normal)) == pytest.approx(1.0, abs=2e-3)
        assert plan.sharing.blocks == (2 * len(normal),) * 2


def test_a_mirror_image_is_as_far_from_the_plane_and_has_the_same_ranges_from_it():
    random = np.random.default_rng(2)
    normal, point = np.array([0.6, 0.0, 0.8]), np.array([1.0, 2.0, 3.0])
    root = random.normal(size=(1, 6, 6))
    belief = Belief(random.normal(size=(1, 6)), root @ root.swapaxes(1, 2))
    image = mirrored(belief, point, normal)
    back = mirrored(image, point, normal)
    np.testing.assert_allclose(back.state, belief.state)
    np.testing.assert_allclose(back.known_covariance, belief.known_covariance)
    agent = point + np.cross(normal, random.normal(size=3))
    here, there = (own_range(Space(), one.state, agent[None], np.array([0.3])) for one in (belief, image))
    assert here[0] == pytest.approx(there[0])
    spreads = [
        row @ one.known_covariance[0] @ row.T for one, (_, row) in zip((belief, image), (here, there), strict=True)
    ]
    assert spreads[0] == pytest.approx(spreads[1])


def test_how_unlikely_a_range_was_is_that_of_a_gaussian_with_a_cut_square_and_nothing_without_one():
    told = Diagnostics.of(6)
    told.nis[:], told.innovation[:] = [2.0, 400.0, np.nan, 0.0, np.inf, 0.5], [3.0, 10.0, 3.0, 3.0, 3.0, np.nan]
    found = _cost(Update(np.zeros((6, 1)), told, (), ()))
    assert found[0] == pytest.approx(2.0 + np.log(9.0 / 2.0))
    assert found[1] - np.log(100.0 / 400.0) < 400.0
    assert found[2:5].tolist() == [0.0] * 3
