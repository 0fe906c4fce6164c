"""Two agents are a network; one is none."""

import pytest

from zenoh_cbef.tracking.filters import KINDS
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.motion.base import MotionSettings
from zenoh_cbef.tracking.motion.ncv import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Space


@pytest.mark.parametrize("kind", KINDS)
def test_an_agent_exchanges_messages_where_there_is_another(kind: str) -> None:
    alone, two = (
        FilterSettings(NearlyConstantVelocity(0.1, 0.3), Space(), range_std=0.1, xi=1.0, network_size=count)
        for count in (1, 2)
    )
    assert KINDS[kind].sharing(two).cooperates == (kind != "local")
    assert kind not in {"sicf", "icf"} or not KINDS[kind].sharing(alone).cooperates


def test_what_a_motion_is_not_told_is_what_a_scenario_means_by_default() -> None:
    told = MotionSettings(0.1, 0.3)
    assert (told.axes, told.interval, told.velocity_time, told.turn_rate_std) == (3, None, 10.0, 1.0)
