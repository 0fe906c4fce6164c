"""Of several processes that want one name, one gets it; real sessions that see each other only through the target."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
import zenoh

from tests.processes.conftest import unused_endpoint
from zenoh_cbef.protocol.claims import Claims, claim, serve_claims
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.session import Connection, open_session

KEYS = Keys("test")


class Hall:
    """A target that tells who has a name, and processes that are linked to it alone."""

    def __init__(self) -> None:
        endpoint = unused_endpoint()
        self.there = Connection([endpoint], gossip=False)
        self.sessions = [open_session(Connection(listen=[endpoint], gossip=False))]
        self.presence = Presence(self.sessions[0], KEYS.all_live)
        self.claims = Claims(self.presence)
        self.service = serve_claims(self.sessions[0], KEYS.claims, self.claims)

    def come(self) -> zenoh.Session:
        self.sessions.append(open_session(self.there))
        return self.sessions[-1]

    def see_off(self, session: zenoh.Session) -> None:
        claims = {name for name in self.presence.names() if name.endswith(f"/{session.zid()}")}
        self.sessions.remove(session)
        session.close()
        assert self.presence.wait(lambda live: not claims & live, 100.0)

    def want(self, session: zenoh.Session, name: str = "agent/1", patience: float = 20.0) -> bool | None:
        presence = Presence(session, KEYS.all_live)
        return claim(session, KEYS.claims, presence, name, patience, connection=self.there)


@pytest.fixture
def hall() -> Iterator[Hall]:
    made = Hall()
    yield made
    for session in reversed(made.sessions):
        session.close()


def test_of_five_that_ask_at_the_same_time_one_has_the_name_until_it_goes(hall: Hall) -> None:
    twins = [hall.come() for _ in range(5)]
    with ThreadPoolExecutor(len(twins)) as pool:
        won = list(pool.map(hall.want, twins))
    assert sorted(won, key=bool) == [False] * 4 + [True]
    assert hall.want(hall.come()) is False  # in mid-run, too
    assert hall.want(hall.come(), "agent/2") is True
    hall.see_off(twins[won.index(True)])
    assert hall.want(hall.come()) is True


def test_who_has_no_claim_gets_no_name(hall: Hall) -> None:
    assert hall.claims.holder("agent/1", "forged") == ""
    assert hall.claims.given("agent/1") == set()
    assert hall.want(hall.come(), "receiver/any", patience=0.3) is None  # there can be several


def test_a_recorder_has_its_name_until_it_goes(hall: Hall) -> None:
    first = hall.come()
    assert hall.want(first, "record/a") is True
    assert hall.claims.given("record/a") == {str(first.zid())}
    assert hall.want(hall.come(), "record/a") is False
    assert hall.want(hall.come(), "record/b") is True
    hall.see_off(first)
    assert hall.claims.holder("record/a", "") == ""
    assert hall.claims.given("record/a") == set(), "the name is free"
    assert hall.want(hall.come(), "record/a") is True


def test_a_process_of_an_earlier_run_has_its_name_until_it_ends(hall: Hall) -> None:
    earlier = Presence(hall.come(), KEYS.all_live)
    earlier.announce("agent/1")
    assert hall.presence.wait(lambda live: "agent/1" in live, 100.0)
    waiting = hall.come()
    assert hall.want(waiting, patience=0.1) is None
    earlier.retract("agent/1")
    assert hall.want(waiting) is True


def test_a_target_that_is_gone_gives_no_name(hall: Hall) -> None:
    hall.service.undeclare()
    assert hall.want(hall.come(), patience=0.3) is None
