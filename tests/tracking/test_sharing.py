"""Two agents are a network; one is none."""

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.tracking.filters import KINDS, Belief, make_filter, sharing_of
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.motion import MOTIONS, MotionSettings, make_motion
from zenoh_cbef.tracking.motion.ncv import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours


@pytest.mark.parametrize("kind", KINDS)
def test_an_agent_exchanges_messages_where_there_is_another(kind: str) -> None:
    alone, two = (
        FilterSettings(NearlyConstantVelocity(0.1, 0.3), Space(), range_std=0.1, xi=1.0, network_size=count)
        for count in (1, 2)
    )
    assert KINDS[kind].sharing(two).cooperates == (kind != "local")
    assert kind not in {"sicf", "icf"} or not KINDS[kind].sharing(alone).cooperates
    biased = [sharing_of("sicf", replace(each, bias="estimate")) for each in (alone, two)]
    assert [each.cooperates for each in biased] == [False, True]


@pytest.mark.parametrize("kind", KINDS)
def test_neighbours_ranges_are_asked_for_where_they_are_used(kind: str) -> None:
    alone, differenced = (
        FilterSettings(NearlyConstantVelocity(0.1, 0.3), Space(), 0.1, 1.0, network_size=3, differenced=one)
        for one in (False, True)
    )
    several = {"kcf", "diffusion", "cbef", "cbef-scaled"}
    assert sharing_of(kind, alone).uses_neighbour_ranges == (kind in several)
    assert sharing_of(kind, differenced).uses_neighbour_ranges == (kind in several | {"ci", "local"})


OPTIONS: dict[str, dict[str, Any]] = {
    "recovery": {"recovery": True},
    "distrust": {"distrust": True},
    "difference": {"measurement": "difference"},
    "bias": {"bias": "estimate"},
    "noise": {"range_std": "auto"},
    "imm": {"motion": "imm"},
    "turn": {"motion": "turn"},
    "lag": {"lag_seconds": 1.0},
}
EVERY = {"turn", "lag"}  # What takes no more than a covariance.
TAKEN = {
    "sicf": EVERY | {"recovery", "distrust", "bias", "noise", "imm"},
    "icf": EVERY | {"recovery", "distrust", "bias", "noise", "imm"},
    "hcmci": EVERY | {"recovery", "distrust", "noise"},
    "ci": EVERY | {"recovery", "distrust", "noise", "difference"},
    "local": EVERY | {"noise", "difference"},  # Alone it has no other agents to compare itself with.
    "kcf": EVERY,
    "diffusion": EVERY,
    "cbef": {"difference"},
    "cbef-scaled": {"difference"},
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_takes_the_options_that_make_sense_in_it(kind: str) -> None:
    taken = set()
    for name, keys in OPTIONS.items():
        with suppress(UserError):
            parse({"filter": {"kind": kind, **keys}}, "test")
            taken.add(name)
    assert taken == TAKEN[kind]


@pytest.mark.parametrize("kind", MOTIONS)
def test_a_motion_made_by_hand_is_the_one_of_the_same_settings(kind: str) -> None:
    one: Any = type(make_motion(kind, MotionSettings(0.1, 0.3)))
    assert one(0.1, 0.3) == one.of(MotionSettings(0.1, 0.3))


@pytest.mark.parametrize("kind", ["ncv", "turn", "stationary"])
def test_an_acceleration_that_lasts_longer_is_a_larger_one_for_the_same_power(kind: str) -> None:
    made = make_motion(kind, MotionSettings(0.1, 0.3, interval=0.4))
    assert made.acceleration_std == pytest.approx(2.0 * 0.3)


def test_what_a_motion_is_not_told_is_what_a_scenario_means_by_default() -> None:
    told = MotionSettings(0.1, 0.3)
    assert (told.axes, told.interval, told.velocity_time, told.turn_rate_std) == (3, None, 10.0, 1.0)


@pytest.mark.parametrize("recovers", [0.0, 0.5])
@pytest.mark.parametrize("distrusts", [False, True])
@pytest.mark.parametrize("around", [{}, {"bias": "estimate"}, {"bias": "auto"}, {"models": ("ncv", "turn")}])
def test_a_message_is_as_long_as_was_agreed(around: dict[str, Any], *, recovers: float, distrusts: bool) -> None:
    motions = tuple(make_motion(kind, MotionSettings(0.1, 0.3)) for kind in around.get("models", ()))
    settings = FilterSettings(
        NearlyConstantVelocity(0.1, 0.3), Space(), 0.1, 1.0, network_size=3, recovers=recovers, distrusts=distrusts,
        common_bias_std=0.3, own_bias_std=0.2, leaving=(0.1,), first_fix=2,
        **{**around, "models": motions},
    )  # fmt: skip
    agreed = sharing_of("sicf", settings).payload_size
    filter_, belief = make_filter("sicf", settings), Belief(np.zeros((1, 6)), np.eye(6)[None])
    for _ in range(4):  # Squared ranges, ranges of the first fix, and two steps of the filter that follows.
        update = filter_.update(belief, Measurement(np.ones((1, 3)), np.array([2.0]), np.zeros(1), *no_neighbours(1)))
        assert update.payload.shape == (1, agreed)
        belief = filter_.conclude(update.payload, update)
