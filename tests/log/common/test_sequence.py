"""Sequence numbers: what is missing, what came late, and who was started again."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.log.common.sequence import LARGEST_JUMP, Sequence, Sequences


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
    sequence = counted([*order])
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


@given(st.integers(1, 20), st.integers(1, 20), st.integers(1, 20), st.booleans())
def test_what_was_sent_while_the_recorder_was_cut_off_is_told_from_what_was_lost(
    before: int, during: int, lost: int, late: bool
) -> None:
    sequence = counted(list(range(before)))
    sequence.cut_off()
    back = before + during
    if late:  # the first message came before the news
        sequence.take(back)
        sequence.heal()
    else:
        sequence.heal()
        sequence.take(back)
    sequence.take(back + 1)
    sequence.take(back + 2 + lost)
    assert (sequence.missing, sequence.unheard) == (during + lost, during)
    sequence.take(before)  # fetched afterwards
    assert (sequence.missing, sequence.unheard) == (during + lost - 1, during - 1)
    assert not sequence.lacks(before)
    assert all(sequence.lacks(number) for number in range(before + 1, back))


def test_a_cut_that_cost_nothing_excuses_nothing() -> None:
    sequence = counted([0, 1])
    sequence.cut_off()
    sequence.heal()
    sequence.take_all([2, 3])
    sequence.take(5)
    assert (sequence.missing, sequence.unheard) == (1, 0)


def test_a_sender_that_does_not_come_back_was_not_heard_to_its_end() -> None:
    sequence = counted([0, 1])
    sequence.cut_off()
    sequence.tell(6)
    assert (sequence.missing, sequence.unheard) == (4, 4)


@given(st.integers(LARGEST_JUMP + 6, 2**63 - 1))
def test_a_number_out_of_all_proportion_makes_nothing_missing(number: int) -> None:
    sequence = counted([0, 1, 2, number, 3, 4, 6])
    assert (sequence.sent, sequence.missing, sequence.absurd, sequence.example) == (7, 1, 1, (number, 3))
    told = counted([0, 1, 2], number)
    assert (told.sent, told.missing, told.absurd) == (3, 0, 1)


def test_who_really_goes_on_from_a_far_number_is_followed_there() -> None:
    sequence = counted([0, 1, 5_000_000, 5_000_001, 5_000_002, 5_000_004])
    assert (sequence.missing, sequence.absurd, sequence.sent) == (1, 2, 7)


def test_the_numbers_of_a_key_are_counted_for_a_bounded_number_of_senders() -> None:
    sequences = Sequences()
    for sender in range(1000):
        sequences.of("key", f"receiver/{sender}").take(0)
    assert len(list(sequences)) == 100
    assert sequences.of("another", "target") is sequences.of("another", "target")


def test_a_crowd_of_senders_on_many_keys_is_not_counted_and_leaves_two_for_each_key() -> None:
    sequences = Sequences()
    for key in range(300):
        for sender in range(100):
            sequences.of(str(key), f"receiver/{sender}").take(0)
    assert len(list(sequences)) < 11_000
    assert sequences.find("299", "receiver/1")
    assert not sequences.find("299", "receiver/2")
