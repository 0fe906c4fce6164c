"""In lockstep the target waits for a recorder that is behind, and only for as long as that gets on."""

import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.nodes.target import following
from zenoh_cbef.nodes.target.following import Following
from zenoh_cbef.nodes.target.progress import Progress
from zenoh_cbef.protocol.claims import Claims
from zenoh_cbef.protocol.messages import encode
from zenoh_cbef.protocol.reached import ask_reached, serve_reached

ESTIMATE = {"state": [0.0] * 6, "innovation": None, "weight": None, "neighbours": [], "received": [], "lost": []}
ESTIMATE |= {"late": [], "latency": [], "covariance": None}
MESSAGES = 4000
"""Of all agents in a step: a recorder may be ten steps behind."""


class Recorder:
    """Tells how far it has got, and counts how often it was asked."""

    def __init__(self, heard: dict[int, int]) -> None:
        self.heard, self.asked = heard, threading.Semaphore(0)

    def reached(self) -> dict[int, int]:
        self.asked.release()
        return self.heard

    def wait_until_asked(self, times: int) -> None:
        for _ in range(times):
            assert self.asked.acquire(timeout=60.0)


@contextmanager
def target_at(step: int, recorder: Recorder) -> Iterator[tuple[Node, Following]]:
    """A target that has heard the estimates of a step from two agents."""
    run = f"following-{uuid.uuid4().hex[:12]}"
    with Node(Identity(run, "target", "target")) as node:
        progress = Progress(node, 2, 60.0, 0.0, claims=Claims(node.presence), begun=step)
        for agent in range(2):
            data = encode(run, f"agent/{agent}", 0, time.time_ns(), {"k": step, **ESTIMATE})
            node.session.put(node.keys.estimate(agent), data)
        assert progress.wait(step)
        queryable = serve_reached(node.session, node.keys, "record/record", recorder.reached)
        node.presence.announce("record/record")
        assert node.wait_for(lambda live: "record/record" in live, 60.0)
        yield node, Following(node, progress, MESSAGES)
        queryable.undeclare()


def test_a_step_does_not_begin_before_the_recorder_is_near_enough():
    recorder = Recorder({0: 30, 1: 19})
    with target_at(30, recorder) as (_, one):
        begun = threading.Event()

        def begin() -> None:
            one.wait(30, lambda: None)
            begun.set()

        waiting = threading.Thread(target=begin)
        waiting.start()
        recorder.wait_until_asked(3)
        assert not begun.is_set()
        recorder.heard = {0: 30, 1: 20}
        assert begun.wait(60.0)
        waiting.join()


def test_a_recorder_that_gets_no_further_is_left_behind_until_it_does(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(following, "_STILL_SECONDS", 0.3)
    recorder = Recorder({0: 30, 1: 5})
    with target_at(30, recorder) as (node, one):
        one.wait(30, lambda: None)
        assert b"record did not get to step 20" in node.told[-1]
        one.wait(41, lambda: None)  # its agent 1 does not count, as nothing of it comes
        assert len(node.told) == 1


def test_an_agent_of_which_nothing_more_has_come_keeps_no_recorder_behind():
    recorder = Recorder({0: 30, 1: 30, 2: 0})
    with target_at(30, recorder) as (node, one):
        one.wait(100, lambda: None)
        one.finish(100)
        assert not node.told


def test_what_a_recorder_says_comes_through_and_nonsense_does_not():
    recorder = Recorder({0: 3, 17: 0})
    with target_at(3, recorder) as (node, _):
        assert ask_reached(node.session, node.keys, 1.0) == {"record/record": {0: 3, 17: 0}}
        recorder.heard = {0: -1}
        assert ask_reached(node.session, node.keys, 1.0) == {}
