"""Many questions to a process that answers slowly: it receives all else meanwhile, and answers the latest."""

from __future__ import annotations

import threading
import time

import pytest
import zenoh

from tests.protocol.conftest import Pair
from tests.waiting import until
from zenoh_cbef.protocol.answering import Answering
from zenoh_cbef.protocol.mailbox import Mailbox

KEY, OTHER, PLACES, QUESTIONS = "cbef/test/slow", "cbef/test/other", 4, 1000


def test_more_questions_than_can_wait_hold_nothing_up_and_those_that_are_dropped_end_at_once(pair: Pair) -> None:
    here, there = pair
    go_on, mailbox = threading.Event(), Mailbox(here, OTHER)

    def reply(query: zenoh.Query) -> None:
        go_on.wait(100.0)
        query.reply(KEY, b"answered")

    answering = Answering(here, KEY, reply, waiting=PLACES)
    go_on.set()
    until(lambda: any(reply.ok for reply in there.get(KEY, timeout=60.0)))
    go_on.clear()
    asked = [there.get(KEY, timeout=100.0) for _ in range(QUESTIONS)]
    there.put(OTHER, b"heard", congestion_control=zenoh.CongestionControl.BLOCK)
    heard = until(mailbox.poll)
    go_on.set()
    answers = [[reply.ok for reply in replies if reply.ok is not None] for replies in asked]
    answering.undeclare()
    assert heard == b"heard"
    assert all(answers[-PLACES:])
    assert 1 <= sum(map(len, answers)) <= PLACES + 2


def test_a_question_that_cannot_be_answered_leaves_the_others_their_answers(
    pair: Pair, capsys: pytest.CaptureFixture[str]
) -> None:
    here, there = pair

    def reply(query: zenoh.Query) -> None:
        query.reply(KEY, str(1 // int(query.parameters.get("by") or "0")).encode())

    def ask(by: int) -> list[bytes]:
        return [one.ok.payload.to_bytes() for one in there.get(f"{KEY}?by={by}", timeout=60.0) if one.ok]

    answering = Answering(here, KEY, reply)
    until(lambda: ask(1))
    assert (ask(0), ask(1)) == ([], [b"1"])
    answering.undeclare()
    assert "ZeroDivisionError" in capsys.readouterr().err


def test_an_answer_that_is_being_given_is_given_to_its_end(pair: Pair) -> None:
    here, there = pair
    begun, ended = threading.Event(), threading.Event()

    def reply(_: zenoh.Query) -> None:
        begun.set()
        time.sleep(0.05)
        ended.set()

    answering = Answering(here, KEY, reply)

    def is_asked() -> bool:
        there.get(KEY, timeout=60.0)
        return begun.wait(0.05)

    until(is_asked)
    answering.undeclare()
    assert ended.is_set()
