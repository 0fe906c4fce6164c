"""Agents in one plane do not say that they track a target of which they have lost the side."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.status import ACQUIRING, TRACKING

THREE = (
    "agents.count=3",
    "agents.positions=[[-8,-5,0],[8,-4,0],[0,9,0]]",
    "target.acceleration_std=0.1",
    "filter.acceleration_std=1",
)
LIAR = 'fault=[{kind="byzantine",agents=[3]}]'


def crossing(speed, *more):
    """What agents say of a target that comes from above the plane of three and is in it after 5 s, and its run."""
    motion = f"target.position=[0,0,{5.0 * speed}]", f"target.velocity=[0.3,0,{-speed}]"
    (trace,) = simulate([load("tracking", [*THREE, *motion, "steps=100", *more]).scenario])
    return trace.diagnostics.status, trace


@pytest.mark.parametrize(("speed", "after"), [(3.0, TRACKING), (0.3, ACQUIRING)])
def test_a_fast_target_is_followed_through_the_plane_and_a_slow_one_may_have_turned_back(speed, after):
    status, _ = crossing(speed)
    assert (status[:, 30] == TRACKING).all()
    assert (status[:, 60:] == after).all()


@pytest.mark.parametrize(("rules", "said"), [(14, TRACKING), (15, ACQUIRING)])
def test_more_than_three_agents_in_one_plane_lose_the_side_too(rules, said):
    four = "agents.count=4", "agents.positions=[[-8,-5,0],[8,-4,0],[0,9,0],[1,1,0]]"
    status, _ = crossing(0.2, *four, f"filter.defaults={rules}")
    assert (status[:, 30] == TRACKING).all()
    assert (status[:, 60:] == said).all()


def test_seconds_count_from_when_the_side_was_lost():
    status, trace = crossing(0.3)
    since = np.flatnonzero(status[0, 30:] == ACQUIRING)[0] + 30
    steps = np.arange(100 - since)
    np.testing.assert_allclose(trace.diagnostics.status_seconds[0, since:], 0.1 * steps, atol=1e-9)


def test_a_fourth_agent_off_the_plane_tells_the_side():
    four = "agents.count=4", "agents.positions=[[-8,-5,0],[8,-4,0],[0,9,0],[1,1,4]]"
    keys = ('fault=[{kind="partition",links={between=[[0,1,2],[3]]},from=3.0,until=7.0}]', "network.graph=complete")
    status, _ = crossing(0.2, *four, *keys)
    # Alone the three lose the side; with the fourth they know it again.
    assert (status[:3, 66] == ACQUIRING).all()
    assert (status[:3, 90:] == TRACKING).all()


@pytest.mark.parametrize(("rules", "said"), [(11, TRACKING), (12, ACQUIRING)])
def test_a_network_at_the_mirror_image_does_not_say_that_it_tracks(rules, said):
    keys = ("agents.count=3", "seed=1025", "steps=230", f"filter.defaults={rules}")
    (trace,) = simulate([load("tracking", keys).scenario])
    error = np.linalg.norm((trace.estimates - trace.truth)[:, 220:, :3], axis=2)
    assert error.min() > 5.0
    assert (trace.diagnostics.status[:, 220:] == said).all()


def test_only_agents_that_may_be_in_one_plane_tell_where_they_are():
    def more(*keys):
        today, before = (Plan(load("tracking", [*keys, f"filter.defaults={n}"]).scenario) for n in (12, 11))
        return today.message_size - before.message_size

    assert more("agents.count=3") == 9
    assert more("agents.count=3", "filter.status=false") == 0
    assert more("agents.count=4") == 0
    assert more("agents.count=2", "filter.planar_height=0") == 5
    # Groups that a liar parts may be of three; agents then tell who is there, too.
    assert more("agents.count=6", LIAR) == 9 + 6


LINE = "agents.count=4", "agents.positions=[[-10,0,0],[-4,0,0],[3,0,0],[10,0,0]]", "steps=60"


def said(*more):
    (trace,) = simulate([load("tracking", [*LINE, *more]).scenario])
    return trace.diagnostics.status


def test_agents_on_a_line_never_say_that_they_track_a_target_in_space():
    past = "target.position=[-3,-4,0]", "target.velocity=[0.2,0.4,0]"
    assert not (said(*past) == TRACKING).any()
    assert (said(*past, "filter.defaults=13") == TRACKING).any()


@pytest.mark.parametrize("known", ["filter.planar_height=0", "agents.positions=[[-10,0,0],[-4,5,0],[3,0,8],[10,0,0]]"])
def test_where_ranges_tell_the_place_they_do(known):
    path = ["target.position=[-3,6,0]", "target.velocity=[0.2,0,0]", "target.acceleration_std=0.01"]
    assert (said(known, *path, "filter.acceleration_std=0.01")[:, -1] == TRACKING).all()


FLAT = "agents.low=[-10,-10,0]", "agents.high=[10,10,0]", "seed=1050", "steps=80"


@pytest.mark.parametrize(
    ("keys", "said"), [((), ACQUIRING), (("filter.defaults=15",), TRACKING), (("target.position=[0,0,6]",), TRACKING)]
)
def test_a_first_fix_knows_no_side_that_guesses_do_not_tell(keys, said):
    """The target begins in the plane, and by older rules the network is 3 m off on the other side."""
    (trace,) = simulate([load("tracking", [*FLAT, *keys]).scenario])
    assert (trace.diagnostics.status[:, -1] == said).all()


CEILING = (
    "sensor.real=true",
    "agents.count=6",
    "agents.positions=[[0,0,5.1],[30,0,4.9],[30,20,5],[0,20,5.1],[15,10,4.9],[8,2,5]]",
    "target.position=[12,9,1]",
    "target.velocity=[0.3,0.2,0]",
    "filter.initial_position_std=20",
    "steps=60",
)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ((), ACQUIRING),
        (("filter.defaults=20",), TRACKING),
        (("filter.initial_position=[12,9,1]", "filter.initial_position_std=1"), TRACKING),
        (("filter.initial_position=[12,9,1]", "filter.initial_position_std=3"), ACQUIRING),
        (("agents.positions=[[0,0,5],[30,0,1],[30,20,5],[0,20,1],[15,10,5],[8,2,1]]",), TRACKING),
    ],
    ids=["told nothing", "older rules", "a guess below", "a vague guess", "off the plane"],
)
def test_anchors_under_a_ceiling_track_where_a_guess_tells_the_side(more, said):
    (trace,) = simulate([load("tracking", [*CEILING, *more]).scenario])
    assert (trace.diagnostics.status[:, 40:] == said).all()


@pytest.mark.parametrize(("std", "sides"), [(1, False), (3, True)])
def test_agents_under_a_ceiling_tell_no_places_where_a_guess_tells_the_side(std, sides):
    told = "filter.initial_position=[12,9,1]", f"filter.initial_position_std={std}"
    assert Plan(load("tracking", [*CEILING, *told]).scenario).settings.sides is sides
    assert Plan(load("tracking", CEILING).scenario).settings.sides is True
