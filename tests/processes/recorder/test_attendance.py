"""When a recorder takes a run, or the replay of one, to be over; tokens of real sessions."""

import time
from functools import partial
from threading import Timer
from types import SimpleNamespace
from typing import Any

import pytest

from tests.processes.conftest import unused_endpoint
from tests.waiting import until
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.recorder import attendance
from zenoh_cbef.nodes.recorder.attendance import Attendance, led_by_a_target
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.session import Connection, open_session

LIVE = Keys("test").all_live


class Watched:
    """One end of a link sees who is there at the other."""

    def __init__(self) -> None:
        endpoint = unused_endpoint()
        self.sessions = [open_session(Connection(listen=[endpoint])), open_session(Connection([endpoint]))]
        here, there = (Presence(session, LIVE) for session in self.sessions)
        self.others, self._seen = there, here
        self.told: list[tuple[str, str]] = []
        # All of a node that attendance looks at.
        node: Any = SimpleNamespace(presence=here, stopping=False, launched=False)
        node.wait_for = partial(Node.wait_for, node)
        self.node = node
        self.watch(patience=30.0)

    def watch(self, patience: float) -> None:
        self.attendance = Attendance(self.node, lambda kind, text, _name: self.told.append((kind, text)), patience)
        self.step = 0

    def see(self, name: str, *, there: bool) -> None:
        assert self._seen.wait(lambda live: (name in live) is there, 100.0)

    def come(self, name: str) -> None:
        self.others.announce(name)
        self.see(name, there=True)
        assert not self.over()

    def over(self) -> bool:
        return self.attendance.over(lacking=False, step=self.step)


@pytest.fixture
def watched():
    made = Watched()
    yield made
    for session in made.sessions:
        session.close()


def until_over(watched: Watched) -> None:
    until(watched.over, "it waits for ever")


def test_a_replay_is_over_when_it_says_so_and_leaves(watched):
    watched.come("replay/replay")
    watched.others.leave("replay/replay")
    watched.see("replay/replay", there=False)
    assert watched.over()
    assert watched.told == []


@pytest.mark.parametrize("who", ["replay/replay", "target/target", "agent/3"])
def test_who_vanishes_is_waited_for_but_not_for_ever(watched, monkeypatch, who):
    monkeypatch.setattr(attendance, "_LOST_SECONDS", 0.5)
    watched.come(who)
    watched.sessions[1].close()
    watched.see(who, there=False)
    assert not watched.over()
    until_over(watched)
    assert [kind for kind, _ in watched.told] == ["left"]


def test_a_run_of_which_nothing_is_seen_is_not_waited_for_for_ever(watched, monkeypatch):
    monkeypatch.setattr(attendance, "_LOST_SECONDS", 0.5)
    assert not watched.over()
    until_over(watched)


def test_without_a_target_agents_are_waited_for_while_they_get_on(watched, monkeypatch):
    monkeypatch.setattr(attendance, "_LOST_SECONDS", 0.3)
    watched.watch(patience=0.0)
    watched.come("agent/3")
    until = time.monotonic() + 0.8
    while time.monotonic() < until:
        watched.step += 1
        assert not watched.over()
        time.sleep(0.02)
    until_over(watched)


@pytest.mark.parametrize(("leader", "led"), [("target/target", True), ("replay/replay", False)])
def test_a_recorder_waits_for_the_name_of_who_told_it_the_scenario(watched, leader, led):
    watched.others.announce("agent/3")
    later = Timer(0.5, watched.others.announce, [leader])
    later.start()
    assert led_by_a_target(watched.node) is led
    later.join()
    assert leader in watched.node.presence
