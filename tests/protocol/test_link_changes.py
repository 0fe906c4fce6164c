"""A process learns at once of links that are made."""

from __future__ import annotations

from queue import Queue

from tests.processes.conftest import unused_endpoint
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.protocol.sockets import on_link_change


def test_who_links_is_told_by_its_id() -> None:
    endpoint, told = unused_endpoint(), Queue[str]()
    with open_session(Connection(listen=[endpoint])) as here:
        on_link_change(here, told.put)
        with open_session(Connection([endpoint])) as there:
            assert told.get(timeout=100.0) == str(there.zid())
