"""health: whether a process is there."""

from __future__ import annotations

from typing import Annotated

import typer

from zenoh_cbef.cli.joining import Joining, Patience, joins
from zenoh_cbef.cli.options import Run
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.health import is_there
from zenoh_cbef.protocol.tls import common_name


def _health(
    who: Annotated[str, typer.Argument(metavar="WHO", help="agent/ID, target or record.")],
    run: Run,
    joining: Joining,
    patience: Patience = 3.0,
) -> None:
    """Ask a run whether a process is there: status 0 if so, 1 if not, 2 if nobody answers or no such run is on."""
    role, _, name = who.partition("/")
    if role not in {"agent", "target", "record"} or (role == "agent") != name.isdecimal():
        raise UserError(f"{who!r} is no process; write agent/ID, as in agent/3, or target, or record")
    connection = joining.connection(common_name(role, name))
    if not is_there(connection, run, f"{role}/{name or role}", patience):
        typer.echo(f"{who} is not in run {run}")
        raise typer.Exit(1)
    typer.echo(f"{who} is in run {run}")


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("health")(joins(_health))
