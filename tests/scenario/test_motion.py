"""Which motion a filter assumes, with which noise, and what an older log meant."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.analysis.design import cannot
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.legacy import as_meant
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.motion import MOTIONS

CIRCLE = ("target.motion=circle", "target.radius=5", "target.period=8")


def plan(*sets: str) -> Plan:
    return load("tracking", sets).plan


@pytest.mark.parametrize("kind", MOTIONS)
def test_a_motion_is_called_by_its_name(kind):
    motion = plan(f"filter.motion={kind}", "filter.velocity_time=3", "filter.turn_rate_std=0.2").motion
    assert isinstance(motion, MOTIONS[kind])
    assert getattr(motion, "time", 3.0) == 3.0
    assert getattr(motion, "turn_rate_std", 0.2) == 0.2


def test_the_noise_is_of_a_key_that_describes_the_motion():
    assert plan("target.acceleration_std=0.7").motion.acceleration_std == 0.7
    assert plan("target.acceleration_std=0.7", "filter.acceleration_std=2").motion.acceleration_std == 2.0
    for kind in ("imm", "ncv"):
        keys = (*CIRCLE, f"filter.motion={kind}")
        circle, other = (plan(*keys, f"target.acceleration_std={std}") for std in (0.1, 0.7))
        assert circle.models == other.models
        assert circle.motion.acceleration_std == other.motion.acceleration_std > 1.0


def test_bounds_and_predictions_are_of_position_and_velocity():
    for kind in ("ncv", "decay", "stationary"):
        assert isinstance(plan(f"filter.motion={kind}").plain_motion, MOTIONS[kind])
    for kind in ("acceleration", "turn"):
        assert isinstance(plan(f"filter.motion={kind}").plain_motion, MOTIONS["ncv"])


def test_an_older_log_means_what_it_meant():
    circle = {"target": {"motion": "circle", "acceleration_std": 0.4}}
    motion = Plan(parse(as_meant(circle), "log")).motion
    assert isinstance(motion, MOTIONS["ncv"])
    assert motion.acceleration_std == 0.4
    assert Plan(parse(circle, "scenario")).motion.acceleration_std > 1.0


@pytest.mark.parametrize("motion", ["circle", "lemniscate", "waypoints"])
def test_a_target_that_may_turn_is_followed_by_several_motions(motion):
    sets = (f"target.motion={motion}", "target.waypoints=[[0,0,0],[9,0,0],[9,9,0]]")
    calm, turn, middle, between, agile = plan(*sets).models
    assert middle.acceleration_std < between.acceleration_std < agile.acceleration_std
    assert isinstance(turn, MOTIONS["turn"])
    assert calm.acceleration_std == turn.acceleration_std < 0.1 * middle.acceleration_std < agile.acceleration_std
    assert plan(*sets).calm_motion == calm
    assert calm.acceleration_std < plan(*sets).plain_motion.acceleration_std < agile.acceleration_std


def test_calm_motions_are_five_times_calmer_than_by_older_rules_unless_their_noise_is_told():
    now, before = (plan(*CIRCLE, f"filter.defaults={rules}").models for rules in (14, 13))
    assert [one.acceleration_std for one in now] == pytest.approx([0.02, 0.02, 5.0, 100.0])
    assert [one.acceleration_std for one in before] == pytest.approx([0.1, 0.1, 5.0, 100.0])
    assert now[2:] == before[2:]
    told = plan(*CIRCLE, "filter.motion=imm", "filter.acceleration_std=0.1").models
    assert [one.acceleration_std for one in told] == pytest.approx([0.1, 0.1, 5.0, 500.0**0.5, 100.0])


@pytest.mark.parametrize(
    "alone",
    [
        ("filter.acceleration_std=3",),
        ("filter.kind=ci",),
        ("filter.kind=cbef",),
        ("filter.recovery=true", "filter.defaults=3"),
        ("sensor.bias=0.3", "filter.defaults=16"),
        ("consensus.trim=1",),
        ("filter.motion=turn",),
        ("filter.defaults=1",),
        ('fault=[{kind="byzantine", agents=[1]}]',),
    ],
)
def test_where_several_do_not_fit_the_motion_is_one(alone):
    assert plan(*CIRCLE).models
    assert not plan(*CIRCLE, *alone).models
    assert not plan().models


def test_the_most_agile_motion_jumps_and_in_older_logs_it_does_not():
    assert isinstance(plan(*CIRCLE).models[-1], MOTIONS["jump"])
    older = Plan(parse(as_meant({"filter": {"defaults": 2}, "target": {"motion": "circle"}}), "a log")).models
    assert [type(one) for one in older] == [MOTIONS[kind] for kind in ("ncv", "turn", "ncv", "ncv")]


CORNERS = ("target.motion=waypoints", "target.speed=8", "target.waypoints=[[0,0,0],[9,0,0],[9,9,0]]")


@pytest.mark.parametrize(
    ("keys", "agile"),
    [
        (("sensor.range_std=0.01",), [10.0, 160.0]),
        (("sensor.range_std=0.01", "filter.defaults=15"), [10.0]),
        (("sensor.range_std=0.02",), [20.0]),
    ],
    ids=["precise", "older rules", "less precise"],
)
def test_a_corner_beyond_what_precise_ranges_leave_open_has_a_motion_of_its_own(keys, agile):
    """2 r/D^2 with r = 8 m/s D, where that is more than ten times the index of 10, in units of sigma/D^2."""
    made = plan(*CORNERS, *keys)
    jumps = [one.acceleration_std for one in made.models if isinstance(one, MOTIONS["jump"])]
    assert jumps == pytest.approx(agile)


def test_the_rate_of_a_turn_hardly_changes_and_in_older_logs_it_did():
    now, older = (
        plan(*CIRCLE).models[1],
        Plan(parse(as_meant({"target": {"motion": "circle"}, "filter": {"defaults": 2}}), "a log")),
    )
    assert now.process_noise[-1, -1] == pytest.approx(0.01**2)
    assert older.models[1].process_noise[-1, -1] == 1.0 * older.scenario.dt
    told = 'filter.models=[{motion="turn", turn_rate_std=0.5, turn_rate_change=0.2}, {motion="turn"}]'
    first, second = plan("filter.motion=imm", told).models
    assert first.process_noise[-1, -1] == pytest.approx(0.1**2)
    assert second.process_noise[-1, -1] == pytest.approx(0.01**2)


def test_in_long_steps_the_rate_of_a_turn_changes_by_the_same_angle():
    def changes(*more):
        return np.sqrt(plan(*CIRCLE, *more).models[1].process_noise[-1, -1])

    assert changes("dt=1.0") == pytest.approx(0.001)
    assert changes("dt=0.02") == pytest.approx(0.01)
    assert changes("dt=1.0", "filter.defaults=22") == pytest.approx(0.01)
    assert changes("dt=1.0", "filter.turn_rate_change=0.01") == pytest.approx(0.01)


def test_the_velocity_of_a_real_target_decays():
    assert isinstance(plan("sensor.real=true").motion, MOTIONS["decay"])
    for kept in ("filter.kind=cbef", "filter.defaults=1", "filter.motion=ncv"):
        assert isinstance(plan("sensor.real=true", kept).motion, MOTIONS["ncv"])


def test_the_models_that_are_told_are_taken():
    models = 'filter.models=[{motion="decay", velocity_time=3}, {motion="acceleration", acceleration_std=2}]'
    slow, fast = plan("filter.motion=imm", models).models
    assert isinstance(slow, MOTIONS["decay"])
    assert (slow.acceleration_std, getattr(slow, "time", None)) == (0.3, 3.0)
    assert isinstance(fast, MOTIONS["acceleration"])
    assert fast.acceleration_std == 2.0


def test_a_prediction_is_not_made_where_it_would_not_hold():
    assert any("several motions" in one for one in cannot(plan(*CIRCLE)))
    assert any("several motions" in one for one in cannot(plan("filter.motion=turn")))
    assert not cannot(plan("filter.motion=decay"))


@pytest.mark.parametrize(
    "sets",
    [
        ("filter.motion=flying",),
        ("filter.kind=cbef", "filter.motion=decay"),
        ("filter.motion=turn", "filter.bias=estimate"),
        ("filter.motion=imm", "filter.bias=estimate"),
        ("filter.motion=imm", "filter.kind=ci"),
        ("filter.motion=imm", "consensus.trim=1"),
        ("filter.motion=imm", 'filter.models=[{motion="ncv"}]'),
        ("filter.motion=imm", 'filter.models=[{motion="imm"}, {motion="ncv"}]'),
        ("filter.motion=ncv", 'filter.models=[{motion="turn"}, {motion="ncv"}]'),
    ],
)
def test_what_does_not_fit_is_refused_with_a_remedy(sets):
    with pytest.raises(UserError, match=r"filter\.(motion|models|bias)"):
        load("tracking", sets)


def test_biases_are_left_alone_where_the_motion_is_not_linear():
    biased = "sensor.bias=0.3"
    assert plan(biased).bias == "estimate"
    assert plan(biased, "filter.motion=turn").bias == "none"
