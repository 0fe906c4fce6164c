"""Plurals."""

from zenoh_cbef.words import counted


def test_one_thing_is_no_plural():
    assert [counted(number, "message") for number in (0, 1, 2)] == ["0 messages", "1 message", "2 messages"]
    assert counted(3, "entry", "entries") == "3 entries"
