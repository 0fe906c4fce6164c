"""router: a Zenoh router from the Python package."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import typer

from zenoh_cbef.cli.joining import Joining, joins, warn_of_exposure
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.router import run_router

_PORT = 7447


def _router(joining: Joining) -> None:
    """Run a router until Ctrl-C; the processes of any run join through it with --client --connect ENDPOINT."""
    if joining.client:
        raise UserError("a router is nobody's client; leave --client out, and name other routers with --connect")
    connection = joining.connection("router", mode="router")
    if not connection.listen and connection.config is None:
        connection = replace(connection, listen=[connection.loopback(_PORT)])
    warn_of_exposure(connection)
    place = ", ".join(connection.listen) or f"the endpoints of {connection.config}"
    run_router(connection, partial(typer.echo, f"a router listens on {place}"))


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("router")(joins(_router))
