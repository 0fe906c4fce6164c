"""Whether a process of a run is there and answers, for whoever has to restart it if it does not."""

from __future__ import annotations

import time

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.presence import live_now
from zenoh_cbef.protocol.session import Connection, open_session

_TARGET = "target/target"


def is_there(connection: Connection, run: str, name: str, patience: float) -> bool:
    """Whether a process, as in "agent/3", is in a run that is on. One that hangs leaves it with its lease.

    Raises UserError where nobody at all answers within `patience` s, and where no such run is on.
    """
    until = time.monotonic() + patience
    with open_session(connection, patience) as session:
        while not (session.info.routers_zid() or session.info.peers_zid()):
            if time.monotonic() > until:
                raise UserError(f"nobody answers at {', '.join(connection.connect)}; check --connect and --tls")
            time.sleep(0.02)
        live = live_now(session, Keys(run).all_live)
    if name not in live and _TARGET not in live:
        raise UserError(f"no run {run!r} is on; check --run, or start its target")
    return name in live
