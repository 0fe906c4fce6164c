"""The fate of a message is a function of the scenario, the same in every process."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.faults import Delay, Fates, Loss

SOURCE = np.array([0, 1, 0, 2, 1, 2])
DESTINATION = np.array([1, 0, 2, 0, 2, 1])


def fates(*faults, source=SOURCE, destination=DESTINATION, seed=7, dt=0.1, rounds=4):
    seeds = np.broadcast_to(np.asarray(seed, dtype=np.uint64), np.shape(source))
    return Fates(faults, seed=seeds, source=source, destination=destination, dt=dt, rounds=rounds)


def loss(probability, **keys):
    return Loss.model_validate({"kind": "loss", "probability": probability, **keys})


def delay(milliseconds, jitter_ms=0.0, **keys):
    return Delay.model_validate({"kind": "delay", "milliseconds": milliseconds, "jitter_ms": jitter_ms, **keys})


def due_flags(all_fates):
    fate = all_fates.of(1, 1)
    return fate.due.tolist(), fate.late.tolist()


NONE, EVERY = [False] * 6, [True] * 6


def test_certain_loss_loses_everything_and_no_loss_nothing():
    assert due_flags(fates(loss(1.0))) == (NONE, NONE)
    assert due_flags(fates(loss(0.0))) == (EVERY, NONE)
    assert due_flags(fates()) == (EVERY, NONE)


@pytest.mark.parametrize("probability", [0.05, 0.3, 0.9])
def test_the_share_of_lost_messages_is_the_probability(probability):
    count = 20_000
    numbers = np.arange(count)
    fate = fates(loss(probability), source=numbers, destination=numbers[::-1]).of(3, 2)
    assert not fate.late.any()
    assert abs(1.0 - fate.due.mean() - probability) < 6 * np.sqrt(probability * (1 - probability) / count)


def test_losses_of_different_rounds_steps_links_and_faults_are_independent():
    numbers = np.arange(20_000)
    half, same = loss(0.5), {"source": numbers, "destination": numbers + 1}
    draws = [
        fates(half, **same).of(1, 1).due,
        fates(half, **same).of(1, 2).due,
        fates(half, **same).of(2, 1).due,
        fates(half, source=numbers + 1, destination=numbers).of(1, 1).due,
        fates(half, seed=8, **same).of(1, 1).due,
        fates(loss(0.0), half, **same).of(1, 1).due,
    ]
    correlation = np.corrcoef(np.array(draws, dtype=float)) - np.eye(len(draws))
    assert np.abs(correlation).max() < 6 / np.sqrt(len(numbers))


def test_two_losses_lose_what_either_of_them_loses():
    numbers = np.arange(1000)
    same = {"source": numbers, "destination": numbers + 1}
    both = fates(loss(0.3), loss(0.2), **same).of(5, 1).due
    first = fates(loss(0.3), **same).of(5, 1).due
    second = fates(loss(0.0), loss(0.2), **same).of(5, 1).due
    np.testing.assert_array_equal(both, first & second)


@settings(deadline=None)
@given(st.integers(0, 2**64 - 1), st.integers(1, 1000), st.integers(0, 20), st.integers(0, 5))
def test_one_receiver_computes_the_same_fates_as_the_whole_network(seed, step, round_, link):
    faults = loss(0.4, links="agent:1"), delay(10.0, 30.0), loss(0.2, **{"from": 5.0})
    whole = fates(*faults, seed=seed).of(step, round_)
    one = fates(*faults, seed=seed, source=SOURCE[[link]], destination=DESTINATION[[link]]).of(step, round_)
    assert one.lost[0] == whole.lost[link]
    assert one.delay[0] == whole.delay[link]


@pytest.mark.parametrize(
    ("links", "expected"),
    [
        ("all", EVERY),
        ("agent:0", [True, True, True, True, False, False]),
        ("agent:2", [False, False, True, True, True, True]),
        ([[0, 1], [2, 1]], [True, False, False, False, False, True]),
        ([], NONE),
    ],
)
def test_a_fault_is_on_the_links_it_names_in_the_direction_it_names(links, expected):
    fault = loss(1.0, links=links)
    assert fault.selects(SOURCE, DESTINATION).tolist() == expected
    due, _ = due_flags(fates(fault))
    assert due == [not on for on in expected]
    assert fates(fault).quiet == (not any(expected))


def test_agents_are_those_that_links_name():
    assert loss(1.0).named() == set()
    assert loss(1.0, links="agent:12").named() == {12}
    assert loss(1.0, links=[[0, 1], [1, 5]]).named() == {0, 1, 5}


def test_a_fault_is_on_from_its_beginning_until_before_its_end():
    faulty = fates(loss(1.0, **{"from": 1.0, "until": 2.0}), dt=0.5)
    lost = [step for step in range(1, 8) if not faulty.of(step, 1).due.any()]
    assert lost == [2, 3]
    open_ended = fates(loss(1.0, **{"from": 1.0}), dt=0.5)
    assert [step for step in range(1, 6) if not open_ended.of(step, 1).due.any()] == [2, 3, 4, 5]


def test_a_fault_acts_also_where_one_before_it_has_not_begun():
    faulty = fates(loss(1.0, **{"from": 5.0}), loss(1.0))
    assert due_flags(faulty) == (NONE, NONE)


@pytest.mark.parametrize("milliseconds", [0.001, 5.0, 20.0, 21.0, 100.0])
def test_a_message_delayed_at_all_misses_its_own_round_and_one_not_delayed_does_not(milliseconds):
    # A delay of d counts as arriving ceil(d / slot) rounds later, and that is at least one.
    assert due_flags(fates(delay(milliseconds))) == (NONE, EVERY)
    assert due_flags(fates(delay(0.0))) == (EVERY, NONE)


def test_delays_add_and_jitter_is_uniform():
    numbers = np.arange(20_000)
    same = {"source": numbers, "destination": numbers + 1}
    fate = fates(delay(10.0, 20.0), delay(5.0), **same).of(1, 1)
    assert not fate.lost.any()
    assert fate.delay.min() >= 0.015
    assert fate.delay.max() < 0.035
    assert abs(fate.delay.mean() - 0.025) < 6 * 0.020 / np.sqrt(12 * len(numbers))


def test_a_message_that_is_lost_is_not_late():
    assert due_flags(fates(loss(1.0), delay(50.0))) == (NONE, NONE)


def test_delay_only_on_some_links_leaves_the_others_on_time():
    due, late = due_flags(fates(delay(50.0, links=[[0, 1]])))
    assert late == [True, *[False] * 5]
    assert due == [False, *[True] * 5]
