"""status: how a run that goes on is doing."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from typing import Annotated

import typer
from rich.live import Live

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.asking import RunName, locate
from zenoh_cbef.cli.options.joining import JoiningCommand, JoiningContext
from zenoh_cbef.cli.options.shared import AsJson
from zenoh_cbef.cli.terminal.console import console
from zenoh_cbef.cli.terminal.status import status_view
from zenoh_cbef.outside.operator import Operator
from zenoh_cbef.outside.status import RunStatus

_EVERY_SECONDS = 1.0


def _status(
    ctx: JoiningContext,
    run: RunName = None,
    once: Annotated[bool, typer.Option("--once", help="Show it once, also on a terminal.")] = False,
    find: Annotated[
        str, typer.Option("--find", metavar="TEXT", help="Only these agents: ids as in 0-9,17, or a host, or a state.")
    ] = "",
    as_json: AsJson = False,
) -> None:
    """Show a run that goes on: agents, hosts, errors, loss and latency, clocks. On a terminal, once a second."""
    name, connection = locate(run, ctx.joining)
    with Operator(name, connection) as operator:
        first = operator.status()
        if as_json:
            typer.echo(json.dumps(asdict(first), indent=2))
        elif once or not console.is_terminal:
            console.print(status_view(first, find))
        else:
            _follow(operator, first, find)


def _follow(operator: Operator, status: RunStatus, find: str) -> None:
    """Show the status until the run is gone, or Ctrl-C."""
    try:
        with Live(status_view(status, find), console=console, auto_refresh=False) as live:
            while (now := operator.status_if_on()) is not None:
                live.update(status_view(now, find), refresh=True)
                time.sleep(_EVERY_SECONDS)
    except KeyboardInterrupt:
        return
    console.print(f"run {operator.run} has ended")


VERB = verb(_status, "status --run mine --once", JoiningCommand)
