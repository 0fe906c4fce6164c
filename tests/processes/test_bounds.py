"""What processes remember of others stays small, however many names and words a program makes up; real sessions."""

import time
import uuid
from collections.abc import Iterator
from typing import Any

import pytest

from tests.waiting import until
from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.nodes.recorder.acknowledgements import Acknowledgements
from zenoh_cbef.nodes.recorder.attendance import Attendance
from zenoh_cbef.nodes.target.survey import Survey
from zenoh_cbef.protocol.messages import encode

MANY = 3000


@pytest.fixture
def node() -> Iterator[Node]:
    with Node(Identity(f"bounds-{uuid.uuid4().hex[:12]}", "record", "record")) as made:
        yield made


def held(one: object) -> int:
    """How many things an object has in its collections."""
    found: list[Any] = [value for value in vars(one).values() if isinstance(value, list | set | dict)]
    return sum(len(value) for value in found)


def test_farewells_of_made_up_names_are_forgotten(node: Node) -> None:
    attendance = Attendance(node, lambda _kind, _text, _name: None, patience=1.0)
    before = held(attendance)
    for number in range(MANY):
        for name in (f"agent/{number + 1000}", f"replay/{number}", f"target/{number}", f"receiver/{number}"):
            attendance.farewell(name)
    assert held(attendance) == before
    attendance.farewell("agent/7")
    attendance.farewell("target")
    assert held(attendance) == before + 2


def test_words_get_one_token_for_each_process_that_is_there(node: Node) -> None:
    given = Acknowledgements(node)
    node.presence.announce("agent/1")
    until(lambda: "agent/1" in node.presence)
    for word in range(MANY):
        for sender in ("agent/1", "target", f"agent/{2 + word % 900}", f"record/{word}", f"receiver/{word}"):
            given.hear(sender, word)
    given.hear("agent/1", None)
    assert held(given) == 4  # the latest word of two processes, and what was given for it

    def tokens() -> set[str]:
        return {name for name in node.presence.names() if name.startswith("heard/")}

    last = {f"heard/agent/1/{MANY - 1}", f"heard/target/{MANY - 1}"}

    def caught_up() -> bool:
        given.catch_up()
        return tokens() == last

    until(caught_up)


@pytest.mark.parametrize("there", [False, True])
def test_events_of_made_up_senders_displace_no_agents(node: Node, there: bool) -> None:
    survey = Survey(node)
    node.presence.announce("agent/1")
    if there:
        for number in range(200):
            node.presence.announce(f"record/{number}")
    until(lambda: len(node.presence.names()) == (201 if there else 1))

    def say(sender: str, kind: str) -> None:
        body = {"kind": kind, "text": "here I am", "data": {}}
        node.session.put(node.keys.event(sender), encode(node.identity.run, sender, 0, time.time_ns(), body))

    say("agent/1", "here")
    for number in range(200):
        say(f"record/{number}", "here")

    def heard_all() -> bool:
        survey.drain()
        return sum(map(len, vars(survey)["_events"].values())) >= (101 if there else 11)

    until(heard_all)
    events = vars(survey)["_events"]
    assert len(events["agent/1"]) == 1
    assert len(events) <= 102  # the agent, a hundred with chosen names, and all others together
    assert len(vars(survey)["_cards"]) == (101 if there else 1)
