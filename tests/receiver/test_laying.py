"""Ranges laid onto steps: the times of the source decide, not when a range comes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.datasets import Dataset
from zenoh_cbef.nodes.receiver.laying import InStep, Latest, Offset
from zenoh_cbef.nodes.receiver.ranged import Ranged
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.paths import step_times

DT, STEPS, AGENTS = 0.5, 12, 3


@settings(deadline=None)
@given(
    times=st.lists(st.floats(0.0, DT * STEPS), min_size=1, max_size=60).map(sorted),
    begin=st.sampled_from([0.0, 100.0, 1.7e9]),
    seed=st.integers(0, 99),
)
def test_steps_get_what_a_dataset_of_the_same_ranges_gives_them(times, begin, seed):
    dice = np.random.default_rng(seed)
    at = begin + np.array(times)
    anchor, distance = dice.integers(AGENTS, size=len(at)), dice.uniform(1.0, 9.0, size=len(at))
    none = np.empty((0, 3))
    recorded = Dataset(("a", "b", "c"), np.eye(3), at, anchor, distance, none[:, 0], none)
    origin = recorded.origin(DT)
    scenario = parse({"dt": DT, "steps": STEPS, "agents": {"count": AGENTS}}, "live")
    emitted, ranges = recorded.beacons(origin + step_times(scenario, STEPS))
    laying, laid = InStep(scenario), []
    for time, one, metres in zip(at.tolist(), anchor.tolist(), distance.tolist(), strict=True):
        laying.add(one, time, Ranged(time, str(one), metres))
        while (found := laying.take()) is not None:
            laid.append(found)
    laying.close(all_=True)
    while len(laid) < STEPS:
        found = laying.take()
        assert found is not None
        laid.append(found)
    told = np.array([[(np.nan, np.nan) if one is None else one for one in each] for each in laid])
    np.testing.assert_array_equal(told[:, :, 0].T, emitted - origin)
    np.testing.assert_array_equal(told[:, :, 1].T, ranges)
    assert laying.late == 0


def test_a_step_is_open_until_a_later_range_or_a_silence_and_then_ranges_are_late():
    laying = InStep(parse({"dt": 1.0, "steps": 3, "agents": {"count": 2}}, "live"))
    laying.close(all_=False)
    assert laying.take() is None, "a silence before the first range closes no step"
    laying.add(0, 10.0, Ranged(10.0, "0", 5.0))
    assert laying.take() is None
    laying.close(all_=False)
    assert laying.take() == [(1.0, 5.0), None]
    laying.add(1, 9.9, Ranged(9.9, "1", 6.0))
    assert laying.late == 1
    laying.add(1, 11.5, Ranged(11.5, "1", 7.0))
    assert laying.take() == [None, None]
    assert laying.take() is None


def test_a_range_that_waited_to_be_read_keeps_its_own_time():
    offset = Offset()
    # The first message waited for a second, as on a busy host; the second one did not.
    assert offset.of(5.0, 106.0) == 101.0
    assert offset.of(6.0, 106.0) == 100.0
    assert offset.of(6.1, 106.9) == 100.0
    assert offset.of(200.0, 300.1) == 100.0, "of the time before"
    assert offset.of(240.0, 340.2) == pytest.approx(100.1), "clocks drift, and what is long past no longer counts"


def test_in_realtime_a_step_takes_the_latest_range_of_its_end_and_late_ones_keep_their_time():
    latest = Latest(2, 1.0)
    for moment, distance in ((100.5, 3.0), (100.9, 4.0), (101.2, 5.0)):
        latest.add(0, moment, distance)
    latest.add(1, 101.5, 9.0)
    first, second = latest.take(1, 100.0), latest.take(2, 100.0)
    assert first[1] is None
    assert first[0] == pytest.approx((0.9, 4.0))
    assert second == [pytest.approx((1.2, 5.0)), pytest.approx((1.5, 9.0))]
    latest.add(0, 101.4, 6.0)  # measured in step 2, came in step 3
    latest.add(1, 99.0, 6.0)  # too old to be of use
    assert latest.take(3, 100.0) == [pytest.approx((1.4, 6.0)), None]
