"""A way to the target that goes mute: the link over it stays open, and nothing comes any more."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest
import zenoh

from tests.processes.conftest import unused_port
from zenoh_cbef.protocol import claims, renewing, scenario_service
from zenoh_cbef.protocol.claims import Claims, claim, serve_claims
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.reach import wait_for_link
from zenoh_cbef.protocol.scenario_service import ScenarioText, fetch_scenario, serve_scenario
from zenoh_cbef.protocol.session import Connection, open_session

KEYS = Keys("test")
TEXT = ScenarioText("seed = 1", "seed = 1\nsteps = 2", "0.1")
LEASE_MS = 600_000
"""So long that no lease ends the mute link."""


class Way:
    """Forwards TCP connections to a port of loopback; from `go_mute` on nothing more of those that are there."""

    def __init__(self, port: int) -> None:
        self._port, self._lock = port, threading.Lock()
        self._sockets: list[socket.socket] = []
        self._mute: set[socket.socket] = set()
        self.made = 0
        self._door = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._door.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):  # it is closed
            while True:
                near = self._door.accept()[0]
                far = socket.create_connection(("127.0.0.1", self._port))
                with self._lock:
                    self._sockets += [near, far]
                    self.made += 1
                for one, other in ((near, far), (far, near)):
                    threading.Thread(target=self._forward, args=(one, other), daemon=True).start()

    def _forward(self, one: socket.socket, other: socket.socket) -> None:
        with suppress(OSError):
            while data := one.recv(65536):
                if one not in self._mute:
                    other.sendall(data)
        with suppress(OSError):
            other.shutdown(socket.SHUT_RDWR)

    def go_mute(self) -> None:
        with self._lock:
            self._mute.update(self._sockets)

    def close(self) -> None:
        with self._lock:
            for one in (self._door, *self._sockets):
                with suppress(OSError):
                    one.shutdown(socket.SHUT_RDWR)
                one.close()


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renewing, "_MUTE_SECONDS", 0.5)
    for service in (scenario_service, claims):
        monkeypatch.setattr(service, "_LONGEST_SECONDS", 1.0)


@pytest.fixture
def target() -> Iterator[tuple[zenoh.Session, int]]:
    port = unused_port()
    with open_session(Connection(listen=[f"tcp/127.0.0.1:{port}"], gossip=False, lease_ms=LEASE_MS)) as session:
        yield session, port


@pytest.fixture
def way(target: tuple[zenoh.Session, int]) -> Iterator[Way]:
    made = Way(target[1])
    yield made
    made.close()


@pytest.mark.slow
def test_who_gets_no_scenario_over_its_link_makes_it_anew(target: tuple[zenoh.Session, int], way: Way) -> None:
    connection = Connection([way.endpoint], gossip=False, lease_ms=LEASE_MS)
    with open_session(connection) as session:
        assert wait_for_link(session, 100.0)
        way.go_mute()
        service = serve_scenario(target[0], "test", lambda: TEXT)
        assert fetch_scenario(session, "test", connection, patience=100.0) == TEXT
        assert way.made > 1
        way.go_mute()
        assert fetch_scenario(session, "test", connection, patience=100.0) == TEXT, "also who is asked and says nothing"
        service.undeclare()


@pytest.mark.slow
def test_who_is_told_nothing_of_the_name_that_it_claims_makes_its_link_anew(
    target: tuple[zenoh.Session, int], way: Way
) -> None:
    service = serve_claims(target[0], KEYS.claims, Claims(Presence(target[0], KEYS.all_live)))
    connection = Connection([way.endpoint], gossip=False, lease_ms=LEASE_MS)
    with open_session(connection) as session:
        assert wait_for_link(session, 100.0)
        way.go_mute()
        presence = Presence(session, KEYS.all_live)
        assert claim(session, KEYS.claims, presence, "agent/1", 100.0, connection=connection) is True
        assert way.made > 1
        service.undeclare()


def test_only_links_that_a_process_makes_itself_are_ended(
    target: tuple[zenoh.Session, int], way: Way, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended: list[zenoh.Link] = []
    monkeypatch.setattr(renewing, "end_link", ended.append)
    monkeypatch.setattr(renewing, "_MUTE_SECONDS", 0.0)
    connection = Connection([way.endpoint], gossip=False, lease_ms=LEASE_MS)
    with open_session(connection) as session:
        assert wait_for_link(session, 100.0)
        assert wait_for_link(target[0], 100.0)
        renewing.Renewal(target[0], connection).note_silence()
        assert ended == []
        renewing.Renewal(session, connection).note_silence()
        assert [str(one.zid) for one in ended] == [str(target[0].zid())]
