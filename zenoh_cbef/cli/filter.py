"""filter: a part of a log as a log."""

from __future__ import annotations

from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.choosing import LOSSY, nothing_matches, selection_of
from zenoh_cbef.cli.options.shared import Compress, End, Exclude, Include, LogFile, NewLog, Start
from zenoh_cbef.cli.terminal.console import errors, tell, warn
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.tools.filtering import filter_log
from zenoh_cbef.words import counted


def _filter(
    log: LogFile,
    output: NewLog,
    include: Include = None,
    exclude: Exclude = None,
    start: Start = None,
    end: End = None,
    attachments: Annotated[bool, typer.Option("--attachments/--exclude-attachments", help="Keep attachments.")] = True,
    metadata: Annotated[bool, typer.Option("--metadata/--exclude-metadata", help="Keep metadata.")] = True,
    compression: Compress = "zstd",
) -> None:
    """Write messages of some topics or of a time range into a new log. Exit status 3 where not all could be read."""
    opened = open_log(log)
    selection = selection_of(opened, include, exclude, start, end)
    with errors.status("copying"):
        count = filter_log(
            opened, output, selection, attachments=attachments, metadata=metadata, compression=compression
        )
    if not count:
        tell(nothing_matches(log))
    warn(opened.damage)
    typer.echo(f"{counted(count, 'message')} in {output}")
    raise typer.Exit(LOSSY if opened.damage else 0)


VERB = verb(_filter, "filter logs/latest -n '.*/round' -o small.mcap")
