"""A session ends soon, though a process that it was told to link to takes its connection and never answers."""

from __future__ import annotations

import socket

import pytest

from tests.processes.conftest import unused_endpoint
from zenoh_cbef.protocol import closing
from zenoh_cbef.protocol import session as sessions
from zenoh_cbef.protocol.closing import _is_half_open, close_soon
from zenoh_cbef.protocol.reach import wait_for_link
from zenoh_cbef.protocol.session import Connection, open_session


@pytest.mark.slow
def test_a_session_that_waits_for_an_answer_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sessions, "_LISTENER_OPEN_MS", 3_600_000)  # for which Zenoh would wait
    monkeypatch.setattr(closing, "_PATIENCE_SECONDS", 0.2)
    place = unused_endpoint()
    with socket.create_server(("127.0.0.1", 0)) as mute, open_session(Connection(listen=[place])) as other:
        told = Connection([place, f"tcp/127.0.0.1:{mute.getsockname()[1]}"], ["tcp/127.0.0.1:0"])
        session = open_session(told)
        mute.settimeout(100.0)
        with mute.accept()[0]:
            assert wait_for_link(session, 100.0)
            with socket.create_server(("127.0.0.1", 0)) as server:
                calling = socket.create_connection(server.getsockname())
                called, _ = server.accept()
            close_soon(session, told)
            assert session.is_closed()
            with calling, called:  # no other connection of the process is touched
                calling.sendall(b"x")
                called.settimeout(10.0)
                assert called.recv(1) == b"x"
            assert not other.is_closed()


def test_a_socket_is_given_up_where_it_is_on_its_way_and_no_link() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket() as idle:
        port = server.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)) as caller:
            own = caller.getsockname()[1]
            assert _is_half_open(caller, set(), {port})
            assert not _is_half_open(caller, {own}, {port})
            assert not _is_half_open(caller, set(), {own})
            assert not _is_half_open(server, set(), {port})
            assert _is_half_open(idle, set(), {port})
