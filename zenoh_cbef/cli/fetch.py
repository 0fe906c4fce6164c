"""fetch: the logs of a run's recorders, from their hosts, as one."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.merge import join
from zenoh_cbef.cli.options.joining import JoiningCommand, JoiningContext
from zenoh_cbef.cli.options.shared import LONGEST_SECONDS, Compress, NewLog, Run
from zenoh_cbef.cli.terminal.console import errors, tell
from zenoh_cbef.errors import UserError
from zenoh_cbef.outside.fetching import fetch_logs
from zenoh_cbef.protocol.log_service import Offer
from zenoh_cbef.words import counted
from zenoh_cbef.writing import must_be_new


class _Display:
    """Says once what is fetched, and shows on a terminal how much of it has come."""

    def __init__(self, bar: Progress) -> None:
        self._bar, self._said = bar, -1
        self.recorders: list[str] = []
        self._task = bar.add_task("waiting for recorders", total=None)

    def wait(self, here: int, wanted: int) -> None:
        if here != self._said:
            self._said = here
            tell(f"{here} of {counted(wanted, 'log')} can be fetched; the others can be when their recorders end")

    def show(self, found: Sequence[Offer], come: int) -> None:
        total = sum(one.size for one in found)
        if not come:
            self.recorders = [one.recorder for one in found]
            names = ", ".join(self.recorders)
            tell(f"fetching {counted(len(found), 'log')}, {total / 1e6:.1f} MB, from {names}")
        self._bar.update(self._task, description="fetching", total=total, completed=come)


def _fetch(
    run: Run,
    ctx: JoiningContext,
    output: NewLog,
    logs: Annotated[
        int, typer.Option(min=0, max=1000, help="How many recorders' logs; default: one for each --connect.")
    ] = 0,
    patience: Annotated[
        float, typer.Option(min=0.1, max=LONGEST_SECONDS, help="Seconds to wait for the end of the recorders.")
    ] = 60.0,
    compression: Compress = "zstd",
) -> None:
    """Fetch the logs of a run from its recorders, which stay for it (record --stay), and join them into one."""
    joining = ctx.joining
    if not joining.connect and joining.config is None:
        raise UserError("fetch needs the recorders' endpoints, as in --connect tcp/192.0.2.2:7448, or their router's")
    must_be_new(output, "choose another name, or move it away")
    wanted = logs or (1 if joining.client else len(joining.connect or ())) or 1
    with (
        tempfile.TemporaryDirectory(prefix=".fetch-", dir=output.absolute().parent) as folder,
        Progress(console=errors, transient=True, disable=not errors.is_terminal) as bar,
    ):
        display = _Display(bar)
        paths = fetch_logs(
            run,
            joining.connection("operator"),
            Path(folder),
            wanted=wanted,
            patience=patience,
            waiting=lambda here: display.wait(here, wanted),
            progress=display.show,
        )
        join(paths, output, compression, display.recorders)


VERB = verb(
    _fetch, "fetch --run mine --connect tcp/192.0.2.1:7448 --connect tcp/192.0.2.2:7448 -o mine.mcap", JoiningCommand
)
