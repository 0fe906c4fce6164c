"""Names that any process may announce where links have no certificates; tokens of real sessions."""

import threading
from threading import Event, Lock, Thread

import pytest
from zenoh import ZError

from tests.processes.conftest import unused_endpoint
from tests.protocol.conftest import Pair
from tests.waiting import until
from zenoh_cbef.protocol import presence
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.session import Connection, open_session

LIVE = Keys("test").all_live
MANY = 1000
"""More than the places that Zenoh gives a callback, 256, and what waits on the way to it."""
MADE_UP = ["agent/1000", "agent/x", "nonsense/deep/er", "life/made-up/1", "over/record/a", "ready/agent/1", "heard/x/1"]


def test_names_that_no_run_has_are_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presence, "_MOST", 20)
    endpoint = unused_endpoint()
    with open_session(Connection(listen=[endpoint])) as here, open_session(Connection([endpoint])) as there:
        seen, hostile = Presence(here, LIVE), Presence(there, LIVE)
        tokens = [*MADE_UP, *(f"record/{n}" for n in range(50)), *(f"heard/agent/1/{n}" for n in range(50))]
        for name in tokens:
            hostile.announce(name)
        hostile.enter("agent/3")
        assert seen.wait(lambda live: "agent/3" in live, 100.0)
        kept = seen.names()
        assert not kept & set(MADE_UP)
        assert len(kept) <= 21
        hostile.leave("agent/3")
        assert seen.wait(lambda live: not live, 100.0)


def test_a_name_has_the_lives_that_are_told_of_it() -> None:
    with open_session(Connection()) as session:
        lives = Presence(session, LIVE).lives(
            {"life/agent/1/a", "life/agent/1/b", "life/record/x/c", "agent/2", "over/agent/1"}
        )
    assert lives == {"agent/1": {"a", "b"}, "record/x": {"c"}}
    assert lives["agent/2"] == set()


def test_who_waits_without_an_end_is_told_of_every_change() -> None:
    looked = Event()

    def there(live: set[str]) -> bool:
        looked.set()
        return "agent/1" in live

    with open_session(Connection()) as session:
        seen = Presence(session, LIVE)
        waits = Thread(target=seen.wait, args=(there, None), daemon=True)
        waits.start()
        assert looked.wait(100)
        seen.announce("agent/1")
        waits.join(20)
        assert not waits.is_alive()


def test_any_number_of_names_may_wait_for_a_lock_that_is_held_while_a_name_is_announced(pair: Pair) -> None:
    here, there = pair
    seen, other = (Presence(session, LIVE) for session in pair)
    lock, came, announced, heard = Lock(), Event(), Event(), set[str]()

    def note(name: str, _joined: bool) -> None:
        with lock:
            heard.add(name)

    def announce() -> None:
        seen.announce("agent/2")
        announced.set()

    seen.on_change(note)
    here.declare_subscriber("after/names", lambda _: came.set())
    names = {f"heard/agent/1/{number}" for number in range(MANY)}
    with lock:
        for name in names:
            other.announce(name)

        def comes() -> bool:
            there.put("after/names", b"")
            return came.wait(0.1)

        until(comes, "what is sent after the names comes")
        Thread(target=announce, daemon=True).start()
        assert announced.wait(100.0)
    until(lambda: heard == names | {"agent/2"})


def test_its_thread_ends_with_its_session() -> None:
    before = set(threading.enumerate())
    with open_session(Connection()) as session:
        Presence(session, LIVE)
        [its] = [one for one in threading.enumerate() if one.name == "presence" and one not in before]
    its.join(100.0)
    assert not its.is_alive()


def test_a_listener_that_fails_does_not_end_what_others_are_told(capfd: pytest.CaptureFixture[str]) -> None:
    told: list[str] = []

    def fail(name: str, _joined: bool) -> None:
        told.append(name)
        raise ZError(name) if name == "agent/1" else RuntimeError(name)

    with open_session(Connection()) as session:
        seen = Presence(session, LIVE)
        seen.on_change(fail)
        for name in ("agent/1", "agent/2", "agent/3"):
            seen.announce(name)
        until(lambda: len(told) == 3)
        assert sorted(told) == ["agent/1", "agent/2", "agent/3"]
    assert "RuntimeError: agent/2" in capfd.readouterr().err
