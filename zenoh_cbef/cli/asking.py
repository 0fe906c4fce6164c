"""How a verb finds a run that goes on, and asks it something."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

import typer

from zenoh_cbef.cli.joining import Joining
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.operator import Operator
from zenoh_cbef.nodes.registry import find_run
from zenoh_cbef.protocol.session import Connection

RunName = Annotated[str | None, typer.Option("--run", help="The run's name; default: the only one on this host.")]


def locate(run: str | None, joining: Joining) -> tuple[str, Connection]:
    """The run that is meant and how to reach it; without --connect it is looked for on this host."""
    if joining.connect is None and joining.config is None:
        run, connect = find_run(run)
        joining = replace(joining, connect=connect)
    if run is None:
        raise UserError("say which run with --run; behind --connect it cannot be looked up")
    return run, replace(joining.connection("operator"), gossip=False)


def ask_run(run: str, connection: Connection, request: dict[str, Any]) -> dict[str, Any]:
    """What a run answers. Raises UserError with the run's own sentence, or with why nobody answers."""
    with Operator(run, connection) as operator:
        return operator.ask(request)
