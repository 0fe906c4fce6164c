"""Two real sessions with a link between them."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
import zenoh

from tests.processes.conftest import unused_endpoint
from zenoh_cbef.protocol.reach import wait_for_link
from zenoh_cbef.protocol.session import Connection, open_session

Pair = tuple[zenoh.Session, zenoh.Session]


@pytest.fixture(autouse=True)
def threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """No thread that the package starts holds up the end of its process."""
    start = threading.Thread.start

    def checked(self: threading.Thread) -> None:
        work = getattr(self, "function", None) or getattr(self, "_target", None)
        assert self.daemon or not str(getattr(work, "__module__", "")).startswith("zenoh_cbef")
        start(self)

    monkeypatch.setattr(threading.Thread, "start", checked)


@pytest.fixture
def pair() -> Iterator[Pair]:
    """One session that listens, and one that has linked to it."""
    endpoint = unused_endpoint()
    with open_session(Connection(listen=[endpoint])) as here, open_session(Connection([endpoint])) as there:
        assert wait_for_link(there, 100.0)
        yield here, there
