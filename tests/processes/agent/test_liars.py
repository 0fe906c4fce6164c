"""A neighbour whose payloads no agent can send, over real sessions: all other agents go on."""

import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import zenoh

from tests.processes.conftest import unused_endpoint
from tests.waiting import until
from zenoh_cbef.nodes.agent.neighbour import Neighbourhood
from zenoh_cbef.nodes.common.alarm import Alarm
from zenoh_cbef.nodes.common.node import Identity
from zenoh_cbef.nodes.common.rejections import Rejections
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.scenario.build import fates_into
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.moderation import LARGEST_SENT

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # what overflows is the point here

PLAN = Plan(
    load("tracking", ["agents.count=2", "network.graph=complete", "consensus.rounds=3", "timing.patience=0.5"]).scenario
)
WIDTH, ROUNDS = PLAN.message_size, PLAN.rounds
KEYS = Keys("test")


class Pair:
    """Agent 0's neighbourhood, and a session that speaks as agent 1."""

    def __init__(self) -> None:
        endpoint = unused_endpoint()
        self.sessions = [open_session(Connection(listen=[endpoint])), open_session(Connection([endpoint]))]
        presence, self.told = Presence(self.sessions[0], KEYS.all_live), list[str]()
        node: Any = SimpleNamespace(
            session=self.sessions[0],
            keys=KEYS,
            identity=Identity("test", "agent", "0"),
            presence=presence,
            clock=time.time_ns,
            stopping=False,
            on_stop=lambda _action: None,
            event=lambda kind, _text, **_data: self.told.append(kind),
        )
        self.rejections = Rejections(node)
        self.neighbourhood = Neighbourhood(
            node, PLAN, [1], fates_into(PLAN, 0, [1]), rejections=self.rejections, alarm=Alarm(), grace=0.0
        )
        Presence(self.sessions[1], KEYS.all_live).enter("agent/1")
        assert presence.wait(lambda live: "agent/1" in live, 100.0)
        self.neighbourhood.look_around()
        self._ear = self.sessions[0].declare_subscriber(KEYS.round(1), zenoh.handlers.FifoChannel(1000))
        self._codec = RoundCodec("test", "agent/1", WIDTH)
        self._mouth = self.sessions[1].declare_publisher(KEYS.round(1))
        # What is sent before it knows who listens goes nowhere.
        until(lambda: self._mouth.matching_status.matching)  # type: ignore[attr-defined]  # as in relay.py

    def say(self, step: int, round_: int, value: float) -> None:
        data = self._codec.encode(0, time.time_ns(), step, round_, np.full(WIDTH, value))
        self._mouth.put(data)
        while self._ear.handler.recv().payload.to_bytes() != data:  # until it has come
            pass

    def hears(self, step: int, round_: int) -> bool:
        received, delivered = self.neighbourhood.round(step, round_, None)
        assert (np.abs(received) <= LARGEST_SENT).all()
        return delivered is None


@pytest.fixture
def pair() -> Iterator[Pair]:
    made = Pair()
    yield made
    for session in made.sessions:
        session.close()


def test_a_liar_beyond_all_numbers_is_waited_for_once_and_counted(pair: Pair) -> None:
    for round_, value in enumerate((1e100, -1e308, np.inf), start=1):
        pair.say(1, round_, value)
        assert not pair.hears(1, round_)
    assert pair.told == ["silent"]  # each wait would say so again
    assert pair.rejections.total >= 1
    pair.say(2, 1, LARGEST_SENT)
    assert pair.hears(2, 1)


def test_a_true_message_is_waited_for_behind_a_forged_one(pair: Pair) -> None:
    pair.say(1, 1, 1e200)
    pair.say(1, 1, 5.0)
    assert pair.hears(1, 1)
    assert pair.told == []
