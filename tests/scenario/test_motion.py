"""Which motion a filter assumes, with which noise, and what an older log meant."""

from __future__ import annotations

import pytest

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
    circle = [plan(*CIRCLE, f"target.acceleration_std={std}").motion.acceleration_std for std in (0.1, 0.7)]
    assert circle[0] == circle[1] > 1.0


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


@pytest.mark.parametrize(
    "sets",
    [
        ("filter.motion=flying",),
        ("filter.kind=cbef", "filter.motion=decay"),
        ("filter.motion=turn", "filter.bias=estimate"),
    ],
)
def test_what_does_not_fit_is_refused_with_a_remedy(sets):
    with pytest.raises(UserError, match=r"filter\.(motion|bias)"):
        load("tracking", sets)


def test_biases_are_left_alone_where_the_motion_is_not_linear():
    biased = "sensor.bias=0.3"
    assert plan(biased).bias == "auto"
    assert plan(biased, "filter.motion=turn").bias == "none"
