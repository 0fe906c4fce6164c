"""record: the recorder process."""

from __future__ import annotations

import json
import sys
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.joining import JoiningCommand, JoiningContext, Patience, identity_of
from zenoh_cbef.cli.options.shared import Run, Stay
from zenoh_cbef.cli.terminal.console import tell
from zenoh_cbef.cli.terminal.one_line import OneLine
from zenoh_cbef.log.common.naming import free_path, left_active
from zenoh_cbef.nodes.common.recording import Status
from zenoh_cbef.nodes.recorder.process import run_recorder
from zenoh_cbef.words import counted


def _record(
    run: Run,
    ctx: JoiningContext,
    output: Annotated[Path, typer.Option("--output", "-o", help="The log to write.")] = Path("run.mcap"),
    keys: Annotated[
        list[str] | None,
        typer.Option(
            "--keys",
            metavar="EXPRESSION",
            help="Only these keys and events, as 'agent/0/**' or 'beacon/*'; repeatable. For a recorder on each host.",
        ),
    ] = None,
    name: Annotated[str, typer.Option("--name", help="This recorder's name, where a run has several.")] = "record",
    patience: Patience = 3.0,
    sync: Annotated[
        bool, typer.Option("--sync", help="Flush to the disk itself, not only to the operating system.")
    ] = False,
    stay: Stay = 0.0,
    status_json: Annotated[bool, typer.Option("--status-json", hidden=True)] = False,
) -> None:
    """Record all traffic of a run into an MCAP log until the run ends."""

    def report(status: Status) -> None:
        if status_json:
            sys.stdout.write(json.dumps(asdict(status)) + "\n")
            sys.stdout.flush()
        elif line.over:
            line.show(f"step {status.step} of {status.steps}, {counted(status.messages, 'message')}")

    log = free_path(output)
    if log != output:
        tell(f"{left_active(output)} is there, of a recorder that was killed or still writes; this one writes {log}")
        tell(f"to join them, when both have ended: zenoh-cbef merge {output} {log} -o FILE")
    identity = identity_of("record", name, run, ctx.joining.connection("record"), patience)
    line = OneLine()
    with closing(line):
        last = run_recorder(identity, log, keys=keys or (), sync=sync, report=report, stay=stay, say=tell)
    if not status_json:
        typer.echo(f"{counted(last.messages, 'message')} in {log}, {last.missing} missing")
    if last.failure:
        lost = f"{last.dropped} messages are not in the log: " if last.dropped else ""
        sys.stderr.write(f"zenoh-cbef: {lost}{last.failure}\n")
        raise typer.Exit(1)


VERB = verb(_record, "record --run mine --connect tcp/192.0.2.1:7447 -o mine.mcap", JoiningCommand)
