"""check: whether a log is sound."""

from __future__ import annotations

import json
from pathlib import Path

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.shared import AsJson, LogFile
from zenoh_cbef.cli.terminal.console import errors
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.tools.check import Findings, check
from zenoh_cbef.log.tools.collection import GOES_ON
from zenoh_cbef.words import counted

_SHOWN = 20


def _check(log: LogFile = Path("logs/latest"), as_json: AsJson = False) -> None:
    """Check a log's structure and CRCs, its sequence numbers, and every message against its schema.

    Exit status: 0 sound, 1 something is wrong, 2 cannot be judged.
    """
    with errors.status("reading"):
        found = check(open_log(log))
    if as_json:
        names = ("messages", "damage", "missing", "gaps", "unheard", "wrong", "out_of_order", "unread")
        print(json.dumps({"sound": found.exit_status == 0, **{name: getattr(found, name) for name in names}}))
    else:
        _tell(found)
    raise typer.Exit(found.exit_status)


def _tell(found: Findings) -> None:
    lines = [f"damage: {sentence}" for sentence in found.damage]
    for name, missing in found.missing.items():
        first, last = found.gaps[name][0] if found.gaps[name] else (0, 0)
        lines.append(f"missing: {missing} of {name}, the first of them {first} to {last}")
    lines += [f"wrong: {count} of {sentence}" for sentence, count in found.wrong.most_common()]
    for line in lines[:_SHOWN]:
        typer.echo(line)
    if len(lines) > _SHOWN:
        typer.echo(f"and {len(lines) - _SHOWN} more, see --json")
    for name, unheard in found.unheard.items():
        typer.echo(f"note: {unheard} of {name} were not heard, as the recorder was cut off from their sender")
    if found.out_of_order:
        early = counted(found.out_of_order, "message was", "messages were")
        typer.echo(f"note: {early} logged before the one before it")
    if found.goes_on:
        typer.echo(f"note: {GOES_ON}")
    if found.unread:
        typer.echo(f"note: messages and their numbers are not checked: {found.unread}")
    sound = "the file is sound" if found.unread else "sound"
    typer.echo(f"{counted(found.messages, 'message')}: " + ("something is wrong" if lines else sound))


VERB = verb(_check, "check logs/latest --json")
