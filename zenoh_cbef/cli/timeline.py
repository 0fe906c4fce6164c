"""timeline: the space-time picture of a part of a log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.analysis.timeline import write_timeline
from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.places import beside, new_file
from zenoh_cbef.cli.options.shared import LONGEST_SECONDS, Force, LogFile
from zenoh_cbef.cli.terminal.console import errors, tell
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.exchange import read_exchange
from zenoh_cbef.log.read.parts import find_log
from zenoh_cbef.plain import whole

_PICTURES = {".svg": "for the picture", ".html": "for a page around it"}
Since = Annotated[
    float | None,
    typer.Option(
        "--from", metavar="S", min=-LONGEST_SECONDS, max=LONGEST_SECONDS, help="From when on, s since the start signal."
    ),
]
Until = Annotated[
    float | None,
    typer.Option(
        "--until", metavar="S", min=-LONGEST_SECONDS, max=LONGEST_SECONDS, help="Until when, s since the start signal."
    ),
]
Steps = Annotated[str | None, typer.Option("--steps", metavar="A:B", help="Steps A to B; default: the first three.")]
Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="The picture, .svg or .html; default: timeline.html beside the log."),
]


def _timeline(
    log: LogFile = Path("logs/latest"),
    since: Since = None,
    until: Until = None,
    steps: Steps = None,
    output: Output = None,
    force: Force = False,
) -> None:
    """Draw the messages between agents over time, and what became of each: agents as lines, messages as arrows.

    Times are real ones, in lockstep too: seconds since the target's start signal.
    """
    picture = beside(find_log(log), "timeline.html") if output is None else new_file(output, _PICTURES, force=force)
    if steps is not None and (since is not None or until is not None):
        raise UserError("--steps and --from or --until name a part in two ways; give one of them")
    if since is not None and until is not None and since >= until:
        raise UserError(f"--from {since:g} is not before --until {until:g}; swap them")
    chosen = None if steps is None else _steps(steps)
    with errors.status("reading and drawing"):
        exchange = read_exchange(log, steps=chosen, since=since, until=until)
        write_timeline(exchange, picture)
    for note in exchange.notes:
        tell(f"note: {note}")
    typer.echo(picture)


def _steps(text: str) -> tuple[int, int]:
    begin, colon, end = text.partition(":")
    first = whole(begin)
    last = whole(end) if colon else first
    if first is None or last is None:
        raise UserError(f"--steps {text!r} is no pair of steps; write it as in --steps 10:12, or --steps 10 for one")
    return first, last


VERB = verb(_timeline, "timeline logs/latest --steps 10:12")
