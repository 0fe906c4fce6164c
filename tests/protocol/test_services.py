"""Services of a run between two real sessions: what one side tells, the other hears as it was told."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import msgpack
import pytest
import zenoh

from tests.protocol.conftest import Pair
from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol import log_service
from zenoh_cbef.protocol.claims import Claims, claim, serve_claims
from zenoh_cbef.protocol.control import ask_control, serve_control
from zenoh_cbef.protocol.directory import Apart, Directory, Place, Told, ask_directory, serve_directory
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.log_service import LogService, fetch, offers
from zenoh_cbef.protocol.messages import LARGEST, VERSION
from zenoh_cbef.protocol.presence import Presence, follow_token, live_now
from zenoh_cbef.protocol.questions import STOP
from zenoh_cbef.protocol.reached import ask_reached, serve_reached
from zenoh_cbef.protocol.relay import Relay
from zenoh_cbef.protocol.replay_service import serve_replay
from zenoh_cbef.protocol.session import Connection

KEYS = Keys("test")
T = TypeVar("T")


def until(ask: Callable[[], T], wanted: Callable[[T], bool], seconds: float = 60.0) -> T:
    """The first answer that is as wanted: a declaration takes a moment to arrive."""
    end = time.monotonic() + seconds
    while not wanted(found := ask()) and time.monotonic() < end:
        time.sleep(0.01)
    return found


def test_a_recorder_tells_how_far_it_has_got_with_each_agent(pair: Pair) -> None:
    here, there = pair
    steps = {3: 7}
    first = serve_reached(here, KEYS, "record/a", lambda: steps)
    assert until(lambda: ask_reached(there, KEYS, 10.0), bool) == {"record/a": {3: 7}}
    steps |= {0: 9}
    second = serve_reached(here, KEYS, "record/b", dict)
    assert until(lambda: ask_reached(there, KEYS, 10.0), lambda found: len(found) == 2) == {
        "record/a": {3: 7, 0: 9},
        "record/b": {},
    }
    first.undeclare()
    second.undeclare()
    assert until(lambda: ask_reached(there, KEYS, 10.0), lambda found: not found) == {}


@pytest.mark.parametrize(
    "told",
    [
        {"agents": [1], "steps": 2},
        {"agents": 1, "steps": [2]},
        {"agents": [1], "steps": [-2]},
        {"agents": ["1"], "steps": [2]},
        {"agents": [1]},
        {"steps": [2]},
        {},
    ],
)
def test_a_recorder_that_tells_something_else_is_not_heard(pair: Pair, told: dict[str, object]) -> None:
    here, there = pair
    odd = here.declare_queryable(
        KEYS.reached("record/odd"), lambda query: query.reply(KEYS.reached("record/odd"), msgpack.packb(told))
    )
    sound = serve_reached(here, KEYS, "record/a", lambda: {1: 2})
    assert until(lambda: ask_reached(there, KEYS, 10.0), bool) == {"record/a": {1: 2}}
    odd.undeclare()
    sound.undeclare()


def test_a_target_tells_a_process_of_those_that_it_links_to(pair: Pair) -> None:
    here, there = pair
    claims = Claims(Presence(here, KEYS.all_live))
    services = serve_claims(here, KEYS.claims, claims), serve_directory(here, KEYS, Directory(claims, lambda *_: True))
    presence = Presence(there, KEYS.all_live)
    life = str(there.zid())
    first, second = (Place(f"agent/{number}", life, "host", (f"tcp/10.0.0.1:{number}",)) for number in (1, 2))
    for place in (first, second):
        assert claim(there, KEYS.claims, presence, place.name, 60.0, connection=Connection())
    assert ask_directory(there, KEYS.links("agent/1"), first) == Told([], {})
    assert ask_directory(there, KEYS.links("agent/2"), second) == Told([first], {})
    assert ask_directory(there, KEYS.links("agent/1"), first, ["agent/2"]) == Told([second], {"agent/2": False})
    told = ask_directory(there, KEYS.links("agent/2"), second, [], ["agent/1"])
    assert told == Told([first], {"agent/1": False})
    again = ask_directory(there, KEYS.links("agent/1"), first, ["agent/2"])
    assert again == Told([second], {"agent/2": True})
    # It speaks for no other process, and is told nothing where it does not have its name.
    assert ask_directory(there, KEYS.links("agent/1"), second) is None
    assert ask_directory(there, KEYS.links("agent/3"), Place("agent/3", life, "host", ())) is None
    for one in services:
        one.undeclare()
    assert Apart("a", "b", carried=True) != Apart("a", "b", carried=False)


def test_a_token_is_followed_as_it_comes_and_goes(pair: Pair) -> None:
    here, there = pair
    seen: list[bool] = []
    follow_token(there, KEYS.target_live, seen.append)
    presence = Presence(here, KEYS.all_live)
    for known in ([True], [True, False], [True, False, True]):
        (presence.announce if known[-1] else presence.retract)("target/target")
        assert until(lambda: [*seen], lambda found, known=known: found == known) == known  # type: ignore[misc]
    assert live_now(there, KEYS.all_live) == {"target/target"}
    assert presence.asks_for("target/target")
    assert not presence.asks_for("target/other")


def test_a_replay_obeys_orders_in_their_order_or_says_why_not(pair: Pair) -> None:
    here, there = pair
    orders: list[tuple[str, str]] = []

    def obey(given: list[tuple[str, str]]) -> dict[str, object]:
        if ("rate", "x") in given:
            raise UserError("a rate is a number")
        orders[:] = given
        return {"paused": True}

    service = serve_replay(here, "test", obey)

    def ask(text: str) -> list[object]:
        replies = there.get(f"{KEYS.replay}?{text}", timeout=10.0)
        return [
            msgpack.unpackb(one.ok.payload.to_bytes()) if one.ok else one.err and one.err.payload.to_bytes()
            for one in replies
        ]

    assert until(lambda: ask("pause;rate=2;;seek=1=5"), bool) == [{"v": VERSION, "run": "test", "paused": True}]
    assert orders == [("pause", ""), ("rate", "2"), ("seek", "1=5")]
    assert ask("rate=x") == [b"a rate is a number"]
    service.undeclare()


def test_orders_to_a_run_are_answered_or_refused_with_its_sentence(pair: Pair) -> None:
    here, there = pair
    asked: list[dict[str, object]] = []

    def answer(request: dict[str, object]) -> dict[str, object]:
        asked.append(request)
        if request.get("step") == 0:
            raise UserError("a run has a step")
        return {"step": 5}

    service = serve_control(here, KEYS.control, answer)
    found = until(lambda: ask_control(there, KEYS.control, STOP, timeout=10.0, step=5), bool)
    assert found == {"step": 5}
    assert asked[-1] == {"v": VERSION, "ask": "stop", "step": 5}
    with pytest.raises(UserError, match=r"^a run has a step$"):
        ask_control(there, KEYS.control, STOP, timeout=10.0, step=0)
    [reply] = there.get(KEYS.control, timeout=10.0)  # a question without a text
    assert reply.ok is not None
    assert "error" in msgpack.unpackb(reply.ok.payload.to_bytes())
    service.undeclare()
    assert until(lambda: ask_control(there, KEYS.control, STOP, timeout=10.0), lambda one: one is None) is None


def test_a_relay_publishes_what_it_is_given_and_knows_whether_it_is_heard(pair: Pair) -> None:
    here, there = pair
    relay = Relay(here, ["cbef/test/a", "cbef/test/b"])
    assert not relay.heard
    heard, came = list[tuple[str, bytes]](), threading.Event()

    def take(sample: zenoh.Sample) -> None:
        heard.append((str(sample.key_expr), sample.payload.to_bytes()))
        came.set()

    there.declare_subscriber("cbef/test/b", take)
    assert until(lambda: relay.heard, bool)
    relay.publish("cbef/test/b", b"said")
    assert came.wait(60.0)
    assert heard == [("cbef/test/b", b"said")]
    with pytest.raises(UserError, match="'//' is no key that can be published on; correct --remap"):
        Relay(here, ["//"])


def test_a_log_is_offered_until_it_is_fetched_and_is_told_when_it_was(
    pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = pair
    assert log_service.PART < LARGEST
    monkeypatch.setattr(log_service, "PART", 100)
    files = [tmp_path / "run.mcap", tmp_path / "run.2.mcap"]
    for number, one in enumerate(files):
        one.write_bytes(bytes(range(250)) * (1 + number))
    service = LogService(here, KEYS, "record/a", files)
    [offer] = until(lambda: offers(there, KEYS), bool)
    assert (offer.recorder, offer.names) == ("record/a", ("run.mcap", "run.2.mcap"))
    assert (offer.sizes, offer.size) == ((250, 500), 750)
    copies, parts = [tmp_path / "one", tmp_path / "two"], list[int]()
    assert not service.fetched.is_set()
    fetch(there, KEYS, offer, copies, parts.append)
    assert [one.read_bytes() for one in copies] == [one.read_bytes() for one in files]
    assert parts == [100, 100, 50, 100, 100, 100, 100, 100]
    assert service.fetched.wait(60.0)
    for wrong in ("file=-1", "file=2", "file=x", "file=0;from=x"):
        assert [one for one in there.get(f"{KEYS.log('record/a')}?{wrong}", timeout=10.0) if one.ok] == []
    service.close()
    assert until(lambda: offers(there, KEYS), lambda found: not found) == []
