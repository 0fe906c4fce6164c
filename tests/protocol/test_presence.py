"""Names that any process may announce where links have no certificates; tokens of real sessions."""

from threading import Event, Thread

import pytest

from tests.processes.conftest import unused_port
from zenoh_cbef.protocol import presence
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.session import Connection, open_session

LIVE = Keys("test").all_live
MADE_UP = ["agent/1000", "agent/x", "nonsense/deep/er", "life/made-up/1", "over/record/a", "ready/agent/1", "heard/x/1"]


def test_names_that_no_run_has_are_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presence, "_MOST", 20)
    endpoint = f"tcp/127.0.0.1:{unused_port()}"
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
