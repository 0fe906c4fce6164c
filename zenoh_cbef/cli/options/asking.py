"""How a verb finds a run that goes on."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Annotated

import typer

from zenoh_cbef.cli.options.completing import runs
from zenoh_cbef.cli.options.joining import Joining
from zenoh_cbef.cli.terminal.console import tell
from zenoh_cbef.errors import UserError
from zenoh_cbef.outside.registry import KnownRun, find_run
from zenoh_cbef.protocol.names import check_run
from zenoh_cbef.protocol.session import Connection

RunName = Annotated[
    str | None,
    typer.Option(
        "--run", callback=check_run, autocompletion=runs, help="The run's name; default: the only one on this host."
    ),
]

_NOTHING_DONE = 1


def locate(
    run: str | None, joining: Joining, *, order: str = "", certificate: str = "operator"
) -> tuple[str, Connection]:
    """The run that is meant and how to reach it; without --connect it is looked for on this host.

    order: what is to be done to the run, as in "end it"; empty for what only looks. A run that was not named and not
    started from this terminal gets an order only where the user agrees; without a terminal to ask on it is refused.
    """
    if not joining.connect and joining.config is None:
        found = find_run(run)
        if run is None and not found.own:
            _make_sure(found, order)
        run, joining = found.name, replace(joining, connect=found.endpoints)
    if run is None:
        raise UserError("say which run with --run; behind --connect it cannot be looked up")
    return run, replace(joining.connection(certificate), gossip=False)


def _make_sure(found: KnownRun, order: str) -> None:
    words = f"the only run on this host is {found}, and it was not started from this terminal"
    if not order:
        tell(f"note: {words}")
    elif not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise UserError(f"{words}; if it is the one that you mean, say so with --run {found.name}")
    elif not typer.confirm(f"{words}; {order}?", err=True):
        typer.echo("nothing was done", err=True)
        raise typer.Exit(_NOTHING_DONE)
