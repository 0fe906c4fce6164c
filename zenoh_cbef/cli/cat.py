"""cat: the messages of a log as text."""

from __future__ import annotations

import sys
from pathlib import Path

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.choosing import LOSSY, nothing_matches, selection_of
from zenoh_cbef.cli.options.shared import End, Exclude, Include, LogFile, Start
from zenoh_cbef.cli.terminal.console import tell, warn
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.tools.show import lines


def _cat(
    log: LogFile = Path("logs/latest"),
    include: Include = None,
    exclude: Exclude = None,
    start: Start = None,
    end: End = None,
) -> None:
    """Print messages by log time, decoded, one JSON object a line. Exit status 3 where not all could be read."""
    opened = open_log(log)
    nothing = True
    for line in lines(opened, selection_of(opened, include, exclude, start, end)):
        sys.stdout.write(line + "\n")
        nothing = False
    if nothing:
        tell(nothing_matches(log))
    warn(opened.damage)
    raise typer.Exit(LOSSY if opened.damage else 0)


VERB = verb(_cat, "cat logs/latest -y '.*/estimate' --start 2s --end 3s")
