"""The router process: passes messages on between clients, for hosts that cannot or should not link to one another."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from dataclasses import replace
from types import FrameType

from zenoh_cbef.protocol.lives import router_life
from zenoh_cbef.protocol.session import Connection, open_session


def run_router(connection: Connection, on_ready: Callable[[], None]) -> None:
    """Run a router until told to stop; on_ready is called when it can be reached."""
    asked = threading.Event()

    def ask(_signum: int, _frame: FrameType | None) -> None:
        asked.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, ask)
    with open_session(replace(connection, life=router_life(carries=True))):
        on_ready()
        while not asked.wait(1.0):
            pass
