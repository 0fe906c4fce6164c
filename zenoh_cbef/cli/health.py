"""health: whether a process is there."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.asking import RunName, locate
from zenoh_cbef.cli.options.joining import JoiningCommand, JoiningContext, Patience
from zenoh_cbef.errors import UserError
from zenoh_cbef.outside.health import is_there
from zenoh_cbef.protocol.keys import agent_named
from zenoh_cbef.protocol.tls import common_name


def _health(
    process: Annotated[str, typer.Argument(metavar="PROCESS", help="agent/ID, target or record.")],
    ctx: JoiningContext,
    run: RunName = None,
    patience: Patience = 3.0,
) -> None:
    """Ask a run whether a process is there: status 0 if so, 1 if not, 2 if no process answers or no such run is on."""
    role, _, name = process.partition("/")
    if role not in {"agent", "target", "record"} or (role == "agent") != (agent_named(process) is not None):
        raise UserError(f"{process!r} is no process; write agent/ID, as in agent/3, or target, or record")
    # What is looked up on this host is asked as by an operator; elsewhere a process has its own certificate alone.
    elsewhere = bool(ctx.joining.connect) or ctx.joining.config is not None
    found, connection = locate(run, ctx.joining, certificate=common_name(role, name) if elsewhere else "operator")
    if not is_there(replace(connection, gossip=ctx.joining.gossip), found, f"{role}/{name or role}", patience):
        typer.echo(f"{process} is not in run {found}")
        raise typer.Exit(1)
    typer.echo(f"{process} is in run {found}")


VERB = verb(_health, "health agent/3 --run mine", JoiningCommand)
