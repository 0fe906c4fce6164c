"""Links that the target names: real sessions in one process, whose links are counted."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from dataclasses import replace

import pytest
import zenoh

from tests.processes.conftest import unused_endpoint
from tests.waiting import until
from zenoh_cbef.protocol.addresses import is_loopback, own_addresses, own_host, parts, reached_at, with_ports
from zenoh_cbef.protocol.introducing import introduce, life_at
from zenoh_cbef.protocol.lives import connects, new_life, site_of
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.protocol.sockets import end_link


class Hall:
    """A session that all others are linked to, as to a target, and which tells none of another."""

    def __init__(self) -> None:
        self.place = unused_endpoint()
        self.sessions: list[zenoh.Session] = []
        self.come([], self.place)

    def come(self, connect: list[str], *listen: str) -> tuple[zenoh.Session, Connection]:
        connection = with_ports(Connection(connect, listen))
        connection = replace(connection, life=new_life(reached_at(connection.listen)))
        session = open_session(connection)
        self.sessions.append(session)
        return session, connection

    def agent(self) -> tuple[zenoh.Session, Connection]:
        return self.come([self.place])


@pytest.fixture
def hall() -> Iterator[Hall]:
    made = Hall()
    yield made
    for session in reversed(made.sessions):
        session.close()


def links(session: zenoh.Session, other: zenoh.Session | None = None) -> list[zenoh.Link]:
    return [one for one in session.info.links() if other is None or str(one.zid) == str(other.zid())]


def met(session: zenoh.Session, count: int) -> bool:
    return until(lambda: len(links(session)) == count)


def test_who_is_introduced_has_one_link_and_a_third_process_hears_nothing(hall: Hall) -> None:
    (first, earlier), (second, later), (third, _) = (hall.agent() for _ in range(3))
    assert all(met(one, 1) for one in (first, second, third))
    assert connects(str(second.zid()), str(first.zid()))  # it came later
    for _ in range(3):  # a link that has ended can be made again
        assert introduce(later.listen[0], earlier.listen[0], later, lambda: bool(links(second, first)))
        assert met(first, 2)
        assert met(second, 2)
        end_link(links(second, first)[0])
        assert met(first, 1)
        assert met(second, 1)
    assert met(third, 1)
    assert met(hall.sessions[0], 3)


@pytest.mark.slow
def test_the_process_that_listens_somewhere_is_known_by_its_life(hall: Hall) -> None:
    session, connection = hall.agent()
    assert site_of(session) == "", "it is linked to no router"
    assert life_at(connection.listen[0], connection) == str(session.zid()) == connection.life
    assert life_at(unused_endpoint(), connection) == ""
    with socket.create_server(("127.0.0.1", 0)) as mute:
        assert life_at(f"tcp/127.0.0.1:{mute.getsockname()[1]}", connection) == ""


def test_who_is_harder_to_reach_connects() -> None:
    public, private, hidden = (
        new_life([f"tcp/{host}:1", "tcp/127.0.0.1:1"]) for host in ("8.8.8.8", "10.0.0.1", "127.0.0.1")
    )
    assert connects(private, public)
    assert connects(hidden, private)
    assert connects(hidden, public)
    assert not connects(public, private)
    later = new_life(["tcp/10.0.0.2:1"])
    assert connects(later, private)
    assert not connects(private, later)
    assert len({new_life([]) for _ in range(100)}) == 100


def test_an_endpoint_on_all_interfaces_stands_for_each_address_loopback_last() -> None:
    connection = with_ports(Connection(listen=["tcp/0.0.0.0:0", "tcp/192.0.2.1:7", "udp/127.0.0.1:0"]))
    port = parts(connection.listen[0])[2]
    assert port > 0
    told = reached_at(connection.listen)
    assert told == [*(f"tcp/{one}:{port}" for one in own_addresses(socket.AF_INET)), "tcp/192.0.2.1:7"]
    assert told[-2] == f"tcp/127.0.0.1:{port}"
    assert [is_loopback(one) for one in ("tcp/[::1]:1", "tls/localhost:1", "tcp/10.0.0.1:1")] == [True, True, False]
    assert "[::1]" in own_addresses(socket.AF_INET6)
    assert own_host() == own_host() != ""
