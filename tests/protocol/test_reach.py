"""Why no process answers, found out with real sockets and sessions."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator

import pytest

from tests.processes.conftest import unused_endpoint, unused_port
from tests.protocol.conftest import Pair
from tests.waiting import until
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.reach import linked, runs_on, unreachable, wait_for_link, why_no_answer
from zenoh_cbef.protocol.session import Connection, open_session


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        one.listen()
        yield one


def test_a_port_that_is_listened_at_is_reached_and_others_are_not(listener: socket.socket) -> None:
    port = listener.getsockname()[1]
    for endpoint in (
        f"tcp/127.0.0.1:{port}",
        f"tls/localhost:{port}",
        f"ws/127.0.0.1:{port}?a=b",
        f"tcp/127.0.0.1:{port}#x",
    ):
        assert unreachable(endpoint) is None
    closed = unused_port()
    for protocol in ("tcp", "tls", "ws"):
        told = unreachable(f"{protocol}/127.0.0.1:{closed}")
        assert told == (
            f"no process listens at {protocol}/127.0.0.1:{closed}; check --connect, and start 'zenoh-cbef target' first"
        )
    assert unreachable(f"udp/127.0.0.1:{closed}") is None, "without a connection there is nothing to refuse"


@pytest.mark.parametrize("place", ["127.0.0.1", "127.0.0.1:", "127.0.0.1:x", ":7447", "[]:1", "127.0.0.1:65536"])
def test_a_place_needs_host_and_port(place: str) -> None:
    assert "has no host or no port" in (unreachable(f"tcp/{place}") or "")


def test_the_last_port_and_addresses_in_brackets_are_places() -> None:
    for place in ("127.0.0.1:65535", "[::1]:65535"):
        assert "has no host" not in (unreachable(f"tcp/{place}") or "")


def test_a_socket_of_this_host_is_a_file(tmp_path) -> None:
    path = tmp_path / "here"
    assert unreachable(f"unixsock-stream/{path}") == f"there is no socket {path}; check --connect"
    path.touch()
    assert unreachable(f"unixsock-stream/{path}") is None


def test_a_name_without_an_address_is_told_from_a_name_service_that_is_silent(monkeypatch) -> None:
    def unknown(*_: object, **__: object) -> None:
        raise socket.gaierror

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    assert "nowhere in udp/nowhere:1 has no address" in (unreachable("udp/nowhere:1") or "")
    over = threading.Event()
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: over.wait(100))
    begun = time.monotonic()
    assert "no name service says which host nowhere in tcp/nowhere:1 is" in (unreachable("tcp/nowhere:1", 0.05) or "")
    assert time.monotonic() - begun < 10
    asks = threading.enumerate()[-1]
    assert asks is not threading.current_thread()
    assert asks.daemon, "a name service does not hold up the end of the program"
    over.set()


def test_a_host_that_says_nothing_and_one_without_a_way_to_it_are_told_apart(monkeypatch) -> None:
    waited: list[float | None] = []
    errors: list[OSError] = [TimeoutError(), OSError(101, "no way")]

    class Deaf(socket.socket):
        def connect(self, _address: object) -> None:
            waited.append(self.gettimeout())
            raise errors.pop(0)

    monkeypatch.setattr(socket, "socket", Deaf)
    assert "tcp/127.0.0.1:1 does not answer" in (unreachable("tcp/127.0.0.1:1", 0.5) or "")
    assert "tcp/127.0.0.1:1 cannot be reached (no way)" in (unreachable("tcp/127.0.0.1:1", 0.5) or "")
    assert waited == [0.5, 0.5]


def test_a_link_is_waited_for_and_runs_behind_it_are_named(pair: Pair) -> None:
    here, there = pair
    assert linked(here)
    assert wait_for_link(there, 0.0)
    connection = Connection(["tcp/a:1", "tcp/b:2"])
    assert runs_on(there) == set()
    assert why_no_answer(there, connection, "mine").startswith("no run is on at tcp/a:1, tcp/b:2; check --run")
    for run in ("other", "another"):
        Presence(here, Keys(run).all_live).announce("target/target")
    until(lambda: runs_on(there) == {"other", "another"})
    told = why_no_answer(there, Connection(), "mine")
    assert told.startswith("there is another, other at the endpoints of its configuration; check --run")
    assert "its target is there but says nothing" in why_no_answer(there, connection, "other")


def test_a_session_without_a_link_is_told_why(listener: socket.socket) -> None:
    with open_session(Connection()) as alone:
        assert not linked(alone)
        begun = time.monotonic()
        assert not wait_for_link(alone, 0.1)
        assert time.monotonic() - begun >= 0.1
        assert why_no_answer(alone, Connection(), "mine").startswith("no other process has linked to this one")
        silent, closed = f"tcp/127.0.0.1:{listener.getsockname()[1]}", unused_endpoint()
        assert why_no_answer(alone, Connection([silent, closed]), "mine").startswith(f"no process listens at {closed}")
        told = why_no_answer(alone, Connection([silent]), "mine")
        assert told.startswith(f"{silent} takes connections but does not answer as Zenoh does")
