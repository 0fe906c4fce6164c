"""What senders remember, and whom they tell."""

from __future__ import annotations

import time

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from tests.processes.conftest import unused_endpoint
from tests.waiting import until
from zenoh_cbef.protocol.memory import Archive, Memory, ask_latest, ask_numbers, ask_since
from zenoh_cbef.protocol.session import Connection, open_session

KEY = "cbef/test/agent/3/round"


@given(st.lists(st.integers(0, 50), max_size=60), st.integers(0, 400))
def test_a_memory_keeps_the_last_messages_that_fit(sizes: list[int], most: int) -> None:
    memory = Memory(most)
    sent = [bytes(size) for size in sizes]
    for number, data in enumerate(sent):
        memory.keep(number, number // 3, data)
    kept = memory.answer(zenoh.Parameters({"first": "0", "last": "1000"}))
    assert sum(map(len, kept)) <= most
    assert kept == sent[len(sent) - len(kept) :]
    if len(kept) < len(sent):
        assert sum(map(len, kept)) + len(sent[-1 - len(kept)]) > most


def test_what_is_too_old_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    memory, now = Memory(), [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    for number in range(100):
        memory.keep(number, None, b"%d" % number)
        now[0] += 1.0
    assert memory.answer(zenoh.Parameters({"first": "0", "last": "99"})) == [b"%d" % n for n in range(39, 100)]


def test_a_memory_has_64_kib_where_nothing_else_is_said() -> None:
    memory = Memory()
    for data in (b"a" * (1 << 15), b"b" * (1 << 15)):
        memory.keep(0, 0, data)
    assert len(memory.answer(zenoh.Parameters({"k": "0"}))) == 2
    memory.keep(1, 1, b"c")
    assert memory.answer(zenoh.Parameters({"first": "0", "last": "1"})) == [b"b" * (1 << 15), b"c"]


def test_one_number_or_nothing_that_is_known_can_be_asked_for() -> None:
    memory = Memory()
    assert memory.answer(zenoh.Parameters({})) == []
    for number in range(5):
        memory.keep(number, None if number == 4 else number, b"%d" % number)
    for asked, expected in (
        ({"first": "3"}, [b"3"]),
        ({"since": "2"}, [b"2", b"3"]),
        ({"k": "9"}, []),
        ({"k": "x"}, []),
        ({"first": "1", "last": "y"}, []),
        ({}, [b"4"]),
    ):
        assert memory.answer(zenoh.Parameters(asked)) == expected


@given(st.text(max_size=20), st.text(max_size=20))
def test_a_question_of_any_kind_is_answered_or_not(name: str, value: str) -> None:
    memory = Memory()
    memory.keep(0, 0, b"0")
    try:
        asked = zenoh.Parameters({name: value})
    except zenoh.ZError:
        return
    assert memory.answer(asked) in ([], [b"0"])


def test_who_missed_messages_asks_for_their_numbers_or_steps() -> None:
    here = unused_endpoint()
    with open_session(Connection(listen=[here])) as sender, open_session(Connection(connect=[here])) as other:
        archive = Archive(sender)
        memory = archive.open(KEY)
        archive.serve("cbef/test/agent/3/*")
        for number in range(12):
            memory.keep(number, number // 3, b"%d" % number)
        assert until(lambda: ask_latest(other, KEY)) == [b"11"]
        assert ask_latest(other, KEY, 1) == [b"3", b"4", b"5"]
        assert ask_since(other, KEY, 3) == [b"9", b"10", b"11"]
        assert ask_numbers(other, KEY, 4, 6) == [b"4", b"5", b"6"]
        assert ask_numbers(other, "cbef/test/agent/3/range", 0, 9) == []
