"""How a verb finds a run that goes on, and asks it something."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from zenoh_cbef.cli.joining import connection_of
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.registry import find_run
from zenoh_cbef.protocol.control import ask_control
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.session import Connection, open_session

RunName = Annotated[str | None, typer.Option("--run", help="The run's name; default: the only one on this host.")]


def locate(run: str | None, connect: list[str] | None, *, client: bool, config: str | None) -> tuple[str, Connection]:
    """The run that is meant and how to reach it; without --connect it is looked for on this host."""
    if connect is None and config is None:
        run, connect = find_run(run)
    if run is None:
        raise UserError("say which run with --run; behind --connect it cannot be looked up")
    return run, connection_of(connect, None, gossip=False, client=client, config=config, lease_ms=5000)


def ask_run(run: str, connection: Connection, request: dict[str, Any]) -> dict[str, Any]:
    """What a run answers. Raises UserError with the run's own sentence, or where nobody answers."""
    with open_session(connection) as session:
        return ask_control(session, Keys(run).control, request)
