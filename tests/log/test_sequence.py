"""Sequence numbers: what is missing, what came late, and who was started again."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.log.sequence import Sequence


def counted(numbers: list[int], told: int | None = None) -> Sequence:
    sequence = Sequence()
    for number in numbers:
        sequence.take(number)
    if told is not None:
        sequence.tell(told)
    return sequence


@given(
    st.lists(
        st.integers(2, 40).flatmap(
            lambda n: st.sets(st.integers(2, n - 1) if n > 2 else st.nothing()).map(lambda lost: (n, lost))
        ),
        max_size=5,
    )
)
def test_every_life_counts_what_it_sent_and_what_is_missing(lives: list[tuple[int, set[int]]]) -> None:
    sequence = Sequence()
    for count, lost in lives:
        kept = [number for number in range(count) if number not in lost]
        for number in kept:
            sequence.take(number)
        sequence.tell(count)
    assert sequence.sent == sum(count for count, _ in lives)
    assert sequence.missing == sum(len(lost) for _, lost in lives)
    listed = [number for first, last in sequence.gaps for number in range(first, last + 1)]
    assert sorted(listed) == sorted(number for _, lost in lives for number in lost)


@given(st.permutations(range(12)))
def test_what_comes_late_is_not_missing(order: list[int]) -> None:
    numbers = [number for number in order if number != 0]
    sequence = counted([0, *numbers])
    assert (sequence.missing, sequence.gaps, sequence.sent) == (0, [], 12)


def test_what_comes_twice_is_counted_once() -> None:
    assert counted([0, 0, 1, 1, 2, 1]).sent == 3


def test_many_at_once_are_the_same_as_one_by_one() -> None:
    sequence = Sequence()
    for numbers in ([0, 1, 2], [3, 4], [7, 8], [0, 1], [2, 5]):
        sequence.take_all(numbers)
    assert (sequence.sent, sequence.missing, sequence.gaps) == (9 + 6, 4, [(5, 6), (3, 4)])


def test_what_a_sender_tells_may_come_before_its_messages() -> None:
    sequence = Sequence()
    sequence.tell(4)
    assert (sequence.sent, sequence.missing, sequence.gaps) == (4, 4, [(0, 3)])
    sequence.take_all([0, 1, 3])
    assert (sequence.sent, sequence.missing, sequence.gaps) == (4, 1, [(2, 2)])


def test_a_foreign_zero_is_no_new_life() -> None:
    assert counted([*range(20), 0, 0, *range(20, 30)], told=30).sent == 30
    late = counted([*range(20), 0], told=25)
    assert (late.sent, late.missing, late.gaps) == (25, 5, [(20, 24)])


def test_forged_high_numbers_do_not_count_against_a_sender_that_tells() -> None:
    sequence = counted([0, 1, 1000, 2, 3], told=4)
    assert (sequence.sent, sequence.missing, sequence.gaps) == (4, 0, [])
