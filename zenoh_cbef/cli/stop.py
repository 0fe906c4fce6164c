"""stop: the end of a run that goes on."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.asking import RunName, locate
from zenoh_cbef.cli.options.joining import JoiningCommand, JoiningContext
from zenoh_cbef.cli.options.shared import LONGEST_SECONDS
from zenoh_cbef.cli.terminal.console import errors
from zenoh_cbef.errors import UserError
from zenoh_cbef.outside.operator import Operator

_POLL_SECONDS = 0.2


def _stop(
    ctx: JoiningContext,
    run: RunName = None,
    patience: Annotated[
        float, typer.Option(min=0.1, max=LONGEST_SECONDS, help="Seconds to wait until all its processes are gone.")
    ] = 60.0,
) -> None:
    """End a run at one step for all its processes, and wait until they are gone."""
    name, connection = locate(run, ctx.joining, order="end it")
    with Operator(name, connection) as operator:
        step = operator.stop()
        when = "before its first step" if step is None else f"after its present step, {step}"
        typer.echo(f"run {name} ends {when}")
        until = time.monotonic() + patience
        with errors.status("") as progress:
            while here := operator.processes():
                waited_for = ", ".join(sorted(here))
                progress.update(f"waiting for {waited_for}")
                if time.monotonic() > until:
                    raise UserError(f"after {patience:g} s there is still {waited_for}; end what hangs on its host")
                time.sleep(_POLL_SECONDS)
    typer.echo(f"run {name} has ended")


VERB = verb(_stop, "stop --run mine", JoiningCommand)
