"""Agents near one plane do not believe their guess of the side that the target is on."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stress import cases, scenario_of
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.around.mirror_images import _cost
from zenoh_cbef.tracking.filters.base import Update
from zenoh_cbef.tracking.mirroring import mirrored
from zenoh_cbef.tracking.ranging import Space, own_range
from zenoh_cbef.tracking.status import ACQUIRING, TRACKING

CASE = cases()["near-a-plane-and-mirror-guess"]
APART = "filter.defaults=25"
"""Rules by which few agents do not tell each other their ranges here."""
TILTED = "agents.positions=[[0,0,-0.2],[9,0,9.3],[0,8,0.2],[7,-8,6.8],[-6,5,-6.2],[-9,-3,-8.8]]"


def off(trace):
    """Position errors, m, and what agents say, both (n, K)."""
    return np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2), trace.diagnostics.status


def test_ranges_decide_the_side_and_till_then_agents_acquire():
    (trace,) = simulate([scenario_of(CASE, ["steps=120", "seed=1001", APART])])
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
        ((TILTED, "filter.kind=ci"), None),
        ((TILTED, "filter.recovery=true"), None),
        ((TILTED, "sensor.bias=0.5"), None),
        ((TILTED, "agents.count=3"), None),
    ],
)
def test_where_agents_are_near_a_plane(more, normal):
    for rules in (25, 26):
        plan = Plan(load("tracking", [*more, f"filter.defaults={rules}"]).scenario)
        assert (plan.plane is None) is (normal is None)
        if normal is None or plan.plane is None:
            continue
        assert abs(np.dot(plan.plane[1], normal)) == pytest.approx(1.0, abs=2e-3)
        # Two filters that average information, or hypotheses, where ranges bend over what they leave open.
        assert plan.tells_ranges is (rules > 25 and TILTED not in more)
        assert plan.tells_ranges or plan.sharing.blocks == (2 * len(normal),) * 2


@pytest.mark.parametrize(
    ("more", "near", "told"),
    [
        (("filter.defaults=8",), False, False),
        (("agents.count=6", "target.motion=circle", "filter.defaults=25"), False, True),
        (("target.motion=circle",), True, True),
        (("consensus.rounds=3",), True, False),
        (("target.motion=circle", "consensus.rounds=3"), True, False),
        (("target.motion=circle", "consensus.rounds=3", "filter.defaults=25"), False, False),
    ],
)
def test_who_keeps_mirror_images_and_how(more, near, told):
    plan = Plan(load("tracking", [TILTED, *more]).scenario)
    assert (plan.plane is not None, plan.tells_ranges) == (near, told)


def test_a_mirror_image_is_as_far_from_the_plane_and_has_the_same_ranges_from_it():
    random = np.random.default_rng(2)
    normal, point = (0.6, 0.0, 0.8), (1.0, 2.0, 3.0)
    root = random.normal(size=(1, 6, 6))
    belief = random.normal(size=(1, 6)), root @ root.swapaxes(1, 2)
    image = mirrored(*belief, (point, normal))
    for there, here in zip(mirrored(*image, (point, normal)), belief, strict=True):
        np.testing.assert_allclose(there, here)
    agent = point + np.cross(normal, random.normal(size=3))
    told = [own_range(Space(), state, agent[None], np.array([0.3])) for state, _ in (belief, image)]
    assert told[0][0] == pytest.approx(told[1][0])
    spreads = [row @ one[1][0] @ row.T for one, (_, row) in zip((belief, image), told, strict=True)]
    assert spreads[0] == pytest.approx(spreads[1])


def test_a_turn_rate_and_biases_have_no_mirror_image():
    state = np.arange(1.0, 10.0)[None]
    image, spread = mirrored(state, np.diag(state[0])[None], ((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)))
    np.testing.assert_array_equal(image, [[1, 2, -1, 4, 5, -6, 7, 8, 9]])
    np.testing.assert_array_equal(spread, np.diag(state[0])[None])


def test_how_unlikely_a_range_was_is_that_of_a_gaussian_with_a_cut_square_and_nothing_without_one():
    told = Diagnostics.of(6)
    told.nis[:], told.innovation[:] = [2.0, 400.0, np.nan, 0.0, np.inf, 0.5], [3.0, 10.0, 3.0, 3.0, 3.0, np.nan]
    found = _cost(Update(np.zeros((6, 1)), told, (), ()))
    assert found[0] == pytest.approx(2.0 + np.log(9.0 / 2.0))
    assert found[1] - np.log(100.0 / 400.0) < 400.0
    assert found[2:5].tolist() == [0.0] * 3
