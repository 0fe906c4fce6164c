"""Two real sessions with a link between them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import zenoh

from tests.processes.conftest import unused_port
from zenoh_cbef.protocol.reach import wait_for_link
from zenoh_cbef.protocol.session import Connection, open_session

Pair = tuple[zenoh.Session, zenoh.Session]


@pytest.fixture
def pair() -> Iterator[Pair]:
    """One session that listens, and one that has linked to it."""
    endpoint = f"tcp/127.0.0.1:{unused_port()}"
    with open_session(Connection(listen=[endpoint])) as here, open_session(Connection([endpoint])) as there:
        assert wait_for_link(there, 100.0)
        yield here, there
