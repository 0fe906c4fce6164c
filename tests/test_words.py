"""Plurals and lists."""

from zenoh_cbef.words import counted, first_of


def test_one_thing_is_no_plural():
    assert [counted(number, "message") for number in (0, 1, 2)] == ["0 messages", "1 message", "2 messages"]
    assert counted(3, "entry", "entries") == "3 entries"


def test_of_a_long_list_the_first_are_named():
    words = [*"abcd"]
    assert [first_of(words[:count], 2) for count in (1, 2, 3, 4)] == ["a", "a and b", "a, b and c", "a, b and 2 more"]
