"""Who is there, seen by the tokens of real sessions: who came, who is another process, who has left for good."""

from __future__ import annotations

import time

from tests.protocol.conftest import Pair
from tests.waiting import until
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.presence import Presence, live_now

LIVE = Keys("test").all_live


def test_a_process_comes_and_goes_and_leaves_and_is_known_by_its_life(pair: Pair) -> None:
    seen, other = (Presence(session, LIVE) for session in pair)
    changes: list[tuple[str, bool]] = []
    seen.on_change(lambda name, joined: changes.append((name, joined)))
    assert (seen.life("agent/3"), seen.is_over("agent/3")) == ("", False)

    def told(number: int) -> None:
        """Wait for so many changes: listeners are told of one after those that wait for it."""
        until(lambda: len(changes) >= number)

    other.enter("agent/3")
    assert seen.wait(lambda live: "agent/3" in live, 100.0)
    assert "agent/3" in seen
    assert "agent/4" not in seen
    first = seen.life("agent/3")
    assert first == str(pair[1].zid())
    told(2)
    assert changes == [(f"life/agent/3/{first}", True), ("agent/3", True)], "the life is told first"

    other.withdraw()
    assert seen.wait(lambda live: not live, 100.0)
    told(4)
    assert changes[2:] == [("agent/3", False), (f"life/agent/3/{first}", False)], "the latest first"
    assert not seen.is_over("agent/3"), "a link may have broken"

    other.enter("agent/3")
    assert seen.wait(lambda live: "agent/3" in live, 100.0)
    assert seen.life("agent/3") == first, "the same process is back"
    other.leave("agent/3")
    assert seen.wait(lambda live: not live, 100.0)
    assert seen.is_over("agent/3")
    assert not seen.is_over("agent/4")
    Presence(pair[0], LIVE).enter("agent/3")
    assert seen.wait(lambda live: "agent/3" in live, 100.0)
    assert seen.life("agent/3") == str(pair[0].zid()) != first
    assert not seen.is_over("agent/3"), "another process has the name"


def test_a_token_is_taken_back_alone_and_the_network_can_be_asked(pair: Pair) -> None:
    seen, other = (Presence(session, LIVE) for session in pair)
    for name in ("ready/1", "ready/2", "agent/1"):
        other.announce(name)
    assert seen.wait(lambda live: len(live) == 3, 100.0)
    assert seen.names() == {"ready/1", "ready/2", "agent/1"}
    assert live_now(pair[0], LIVE) == {"ready/1", "ready/2", "agent/1"}
    assert live_now(pair[0], f"{Keys('test').root}/live/ready/**") == {"1", "2"}
    assert seen.asks_for("agent/1")
    assert not seen.asks_for("agent/2")
    other.retract("ready/1")
    assert seen.wait(lambda live: live == {"ready/2", "agent/1"}, 100.0)
    assert not seen.asks_for("ready/1")
    other.withdraw()
    assert seen.wait(lambda live: not live, 100.0)


def test_who_looks_later_sees_what_is_there_and_a_wait_ends(pair: Pair) -> None:
    Presence(pair[1], LIVE).announce("agent/1")
    late = Presence(pair[0], LIVE)
    assert late.wait(lambda live: "agent/1" in live, 100.0)
    begun = time.monotonic()
    assert late.wait(lambda live: len(live) > 1, 0.1) is False
    assert time.monotonic() - begun >= 0.1
    copied = late.names()
    copied.clear()
    assert "agent/1" in late
