"""What faults leave behind: marks and counts, cut links, absences in steps, clocks, delays where messages may wait."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from zenoh_cbef.faults import Absences, AnyFault, Crash, Delay, Fates, Outage
from zenoh_cbef.faults.base import Between, Fault
from zenoh_cbef.faults.clock import Clock, ahead, clocks_of
from zenoh_cbef.faults.injected import ABSENT, FATES, IN_TIME, Injected
from zenoh_cbef.faults.partition import Partition

ANY: TypeAdapter = TypeAdapter(AnyFault)
SOURCE, DESTINATION = np.array([0, 1, 2]), np.array([1, 2, 0])


def fates(*faults: Fault, **keys) -> Fates:
    return Fates(
        faults,
        seed=np.full(3, 1, dtype=np.uint64),
        source=SOURCE,
        destination=DESTINATION,
        dt=0.1,
        rounds=2,
        **keys,
    )


def loss(probability, **keys):
    return ANY.validate_python({"kind": "loss", "probability": probability, **keys})


def test_every_message_has_a_mark_and_every_strike_is_counted_since_the_start():
    apart = np.array([[False, True], [False, False], [False, False]])
    struck = fates(loss(1.0, links=[[1, 2]]), apart=apart)
    injected = Injected(3)
    for step in (1, 2):
        for round_ in (1, 2):
            injected.note(struck.of(step, round_))
        told = injected.take()
        assert told.counts["injected_lost"] == [0, 2 * step, 0]
        assert told.counts["corrupted"] == told.counts["duplicated"] == told.counts["injected_late"] == [0, 0, 0]
        assert told.fields()[FATES] == told.marks == [(IN_TIME if step == 1 else ABSENT) * 2, "xx", IN_TIME * 2]
    injected.forget(slice(1, 2))
    injected.note(fates().of(1, 1))
    assert injected.take().fields() == {
        name: [0, 0, 0] for name in ("injected_lost", "injected_late", "corrupted", "duplicated")
    }


def test_what_was_told_of_a_step_does_not_change_with_the_next():
    injected, struck = Injected(3), fates(loss(1.0))
    injected.note(struck.of(1, 1))
    told = injected.take()
    injected.note(struck.of(2, 1))
    assert told.counts["injected_lost"] == [1, 1, 1]
    assert told.marks == ["x", "x", "x"]


def test_a_message_that_may_wait_is_late_only_by_what_it_takes_longer():
    slow = fates(Delay(kind="delay", milliseconds=150.0), lag=1).of(1, 1)
    np.testing.assert_allclose(slow.delay, 0.05)
    assert slow.late.all()
    fast = fates(Delay(kind="delay", milliseconds=50.0), lag=1).of(1, 1)
    assert not fast.delay.any()
    assert not fast.late.any()


def test_who_keeps_asking_is_answered_over_all_links_that_exist_and_are_not_cut():
    apart = np.array([[False, True, False], [False, False, True], [False, False, False]])
    outage = Outage.model_validate({"kind": "outage", "agents": (2,), "from": 0.25})
    open_ = fates(loss(1.0), outage, apart=apart)
    # Loss hides single messages, not a link; agent 2 is at either end of the last two from step 3 on.
    assert [open_.reaches(step).tolist() for step in (1, 2, 3)] == [
        [True, True, True],
        [False, True, True],
        [True, False, False],
    ]
    partition = Partition.model_validate({"kind": "partition", "from": 0.25, "until": 0.35})
    assert [fates(partition).reaches(step).any() for step in (2, 3, 4)] == [True, False, True]


def test_stretches_are_the_parts_of_a_run_without_the_same_agents():
    def away(agent, since, until):
        return Crash.model_validate({"kind": "crash", "agents": (agent,), "from": since, "until": until})

    absences = Absences([away(0, 0.2, 0.4), away(1, 0.3, 0.6)], agents=3, dt=0.1, steps=8)
    assert absences.stretches() == [(2, 2), (3, 3), (4, 5)]
    assert Absences([], agents=3, dt=0.1, steps=8).stretches() == []
    last = Absences([away(2, 0.7, 9.0)], agents=3, dt=0.1, steps=8)
    assert last.stretches() == [(7, 8)]


def test_an_agents_clock_is_ahead_by_all_its_faults_while_they_are_on():
    first = Clock.model_validate({"kind": "clock", "agents": (1,), "offset": 2.0, "drift": 0.5, "from": 10.0})
    second = Clock(kind="clock", agents=(1, 2), offset=-1.0, until=30.0)
    faults = [first, loss(0.5), second]
    assert clocks_of(faults, 1) == [first, second]
    assert clocks_of(faults, 2) == [second]
    assert clocks_of(faults, 0) == []
    assert [ahead([first, second], time) for time in (5.0, 10.0, 20.0, 40.0)] == [-1.0, 1.0, 6.0, 17.0]


def test_groups_of_a_scenario_are_what_they_were_read_as():
    groups = Between(between=((0,), (1,)))
    with pytest.raises(ValidationError, match="frozen"):
        groups.between = ((0,), (2,))
