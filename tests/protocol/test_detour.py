"""Two processes that reach the target alone hear each other through it: real sessions in one process."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import pytest
import zenoh

from tests.processes.conftest import unused_endpoint
from tests.waiting import until
from zenoh_cbef.protocol.claims import Claims, claim, serve_claims
from zenoh_cbef.protocol.detour import Detour
from zenoh_cbef.protocol.directory import Apart, Directory, Place, Told
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.memory import Archive, ask_latest
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.session import Connection, open_session

KEYS = Keys("test")


@dataclass
class End:
    """A process that is linked to the target alone."""

    session: zenoh.Session
    presence: Presence
    detour: Detour

    def lead(self, name: str, *, mutual: bool) -> bool:
        """Ask for a detour to another process until there is one, as links do: one question can go unanswered."""

        def led() -> bool:
            self.detour.lead({name: mutual})
            return self.detour.heard() == [name]

        return until(led)

    def is_told(self, life: str, name: str) -> bool:
        """Whether the name and the life of another process come in, which each may do first."""
        return until(lambda: name in self.presence and self.presence.life(name) == life)


@pytest.fixture
def ends() -> Iterator[dict[str, End]]:
    place = unused_endpoint()
    with open_session(Connection(listen=[place])) as target:
        hub, made = Presence(target, KEYS.all_live), {}
        hub.enter("target/target")
        for name in ("agent/1", "agent/2", "record/record"):
            connection = Connection([place])
            session = open_session(connection)
            presence = Presence(session, KEYS.all_live)
            assert presence.wait(lambda live: "target/target" in live, 100.0)
            presence.enter(name)
            made[name] = End(session, presence, Detour(session, presence, KEYS, name, connection))
        assert hub.wait(lambda live: live >= made.keys(), 100.0)
        yield made
        for end in made.values():
            end.detour.close()
            end.session.close()


def test_messages_names_and_questions_go_through_the_target(ends: dict[str, End]) -> None:
    first, second = ends["agent/1"], ends["agent/2"]
    archive = Archive(second.session)
    archive.open(KEYS.round(2)).keep(0, 1, b"kept")
    archive.serve(KEYS.of_agent(2))
    mailbox = Mailbox(first.session, KEYS.round(2))
    publisher = second.session.declare_publisher(KEYS.round(2), allowed_destination=zenoh.Locality.REMOTE)
    publisher.put(b"before")
    assert "agent/2" not in first.presence
    assert ask_latest(first.session, KEYS.round(2)) == []
    assert not ends["record/record"].presence.names() & {"agent/1", "agent/2"}

    assert first.lead("agent/2", mutual=False)
    until(lambda: publisher.matching_status.matching)  # type: ignore[attr-defined]  # as in relay.py
    publisher.put(b"after")
    assert mailbox.receive() == b"after"
    until(lambda: ask_latest(first.session, KEYS.round(2)) == [b"kept"])
    assert "agent/2" not in first.presence  # which does not hear us yet

    assert first.lead("agent/2", mutual=True)
    assert first.is_told(str(second.session.zid()), "agent/2")
    assert "record/record" not in first.presence
    second.presence.leave("agent/2")
    assert first.presence.wait(lambda live: "agent/2" not in live, 100.0)

    second_session = vars(first.detour)["_client"]
    first.detour.lead({})
    assert first.detour.heard() == []
    assert second_session.is_closed()
    until(lambda: not publisher.matching_status.matching)  # type: ignore[attr-defined]


@pytest.mark.slow
def test_a_recorder_hears_events_and_an_agent_that_its_last_words_were_heard(ends: dict[str, End]) -> None:
    agent, recorder = ends["agent/1"], ends["record/record"]
    assert recorder.lead("agent/1", mutual=True)
    assert agent.lead("record/record", mutual=True)
    mailbox = Mailbox(recorder.session, KEYS.all_events)
    publisher = agent.session.declare_publisher(KEYS.event("agent/1"), allowed_destination=zenoh.Locality.REMOTE)
    until(lambda: publisher.matching_status.matching)  # type: ignore[attr-defined]
    publisher.put(b"word")
    assert mailbox.receive() == b"word"
    assert recorder.presence.wait(lambda live: "agent/1" in live, 100.0)
    recorder.presence.announce("heard/agent/1/7")
    assert agent.presence.wait(lambda live: {"record/record", "heard/agent/1/7"} <= live, 100.0)
    second_session = vars(agent.detour)["_client"]
    agent.detour.close()
    assert second_session.is_closed()
    agent.detour.lead({"record/record": True})
    assert vars(agent.detour)["_client"] is None  # it has ended for good


def test_the_directory_tells_both_ends_of_a_detour_and_when_the_other_listens() -> None:
    place = unused_endpoint()
    with open_session(Connection(listen=[place])) as target:
        claims = Claims(Presence(target, KEYS.all_live))
        service = serve_claims(target, KEYS.claims, claims)
        directory = Directory(claims, lambda one, other: {one, other} != {"agent/1", "agent/3"})
        sessions = [open_session(Connection([place])) for _ in range(3)]
        places = []
        for number, session in enumerate(sessions, 1):
            name = f"agent/{number}"
            presence = Presence(session, KEYS.all_live)
            assert claim(session, KEYS.claims, presence, name, 100.0, connection=Connection([place]))
            places.append(Place(name, str(session.zid()), "host", ()))
        first, second, third = places
        assert directory.tell(first) == Told([], {})
        assert directory.tell(third) == Told([], {})
        assert directory.tell(second, ("agent/1",)) == Told([first, third], {"agent/1": False})
        assert directory.apart() == [Apart("agent/1", "agent/2", carried=False)]
        assert directory.tell(first, (), ("agent/2",)) == Told([second], {"agent/2": False})
        assert directory.tell(second, ("agent/1",), ("agent/1",)) == Told([first, third], {"agent/1": True})
        assert directory.apart() == [Apart("agent/1", "agent/2", carried=True)]
        assert directory.tell(second) == Told([first, third], {})
        assert directory.apart() == []
        assert directory.tell(Place("agent/1", second.life, "host", ())) is None  # which it is not
        # Of two sites neither links to the other; one of no site links to both.
        assert directory.tell(replace(first, site="a1")) == Told([second], {})
        assert directory.tell(replace(second, site="b2")) == Told([third], {})
        service.undeclare()
        for session in sessions:
            session.close()
