"""router: a Zenoh router from the Python package."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.joining import JoiningCommand, JoiningContext, warn_of_exposure
from zenoh_cbef.errors import UserError
from zenoh_cbef.outside.router import run_router
from zenoh_cbef.protocol.session import PORT, configuration


def _router(
    ctx: JoiningContext,
    print_config: Annotated[
        bool, typer.Option("--print-config", help="Print the configuration for zenohd, and run nothing.")
    ] = False,
) -> None:
    """Run a router until Ctrl-C; the processes of any run join through it with --client --connect ENDPOINT."""
    if ctx.joining.client:
        raise UserError("a router cannot join as a client; leave --client out, and name other routers with --connect")
    connection = ctx.joining.connection("router", mode="router")
    if not connection.listen and connection.config is None:
        connection = replace(connection, listen=[connection.loopback(PORT)])
    if print_config:
        typer.echo(configuration(connection))
        return
    warn_of_exposure(connection)
    place = ", ".join(connection.listen) or f"the endpoints of {connection.config}"
    run_router(connection, partial(typer.echo, f"a router listens on {place}"))


VERB = verb(_router, "router --listen tcp/192.0.2.1:7447", JoiningCommand)
