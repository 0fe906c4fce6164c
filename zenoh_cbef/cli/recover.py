"""recover: a whole log from a damaged one."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.completing import logs
from zenoh_cbef.cli.options.shared import Compress, NewLog
from zenoh_cbef.cli.terminal.console import errors, tell, warn
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import ACTIVE
from zenoh_cbef.log.read.parts import find_log, open_log
from zenoh_cbef.log.tools.collection import GOES_ON, goes_on
from zenoh_cbef.log.tools.recover import recover
from zenoh_cbef.words import counted

Damaged = Annotated[
    Path, typer.Argument(metavar="LOG", autocompletion=logs, help="A log file, cut off or damaged, or a run's folder.")
]


def _recover(log: Damaged, output: NewLog, compression: Compress = "zstd") -> None:
    """Write what can be read of a log, attachments and metadata included, into a new one with its index.

    Exit status: 0 nothing was lost, 3 something was lost, 1 nothing could be recovered.
    """
    source = find_log(log)
    growing = False
    with suppress(UserError):  # of a damaged head no run can be told
        growing = source.name.endswith(ACTIVE) and goes_on(open_log(source))
    with errors.status("copying"):
        found = recover(source, output, compression, growing=growing)
    if growing:
        tell(f"note: {GOES_ON}")
    warn(found.lost)
    if found.exit_status == 1:
        typer.echo("nothing could be recovered")
    else:
        typer.echo(
            f"{counted(found.messages, 'message')}, {counted(found.attachments, 'attachment')}, "
            f"{found.metadata} metadata in {output}; " + ("something was lost" if found.lost else "nothing was lost")
        )
    raise typer.Exit(found.exit_status)


VERB = verb(_recover, "recover cut.mcap -o whole.mcap")
