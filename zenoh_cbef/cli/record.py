"""record: the recorder process."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.joining import Client, Config, Gossip, Lease, Patience, connection_of, identity_of
from zenoh_cbef.cli.options import Connect, Listen, Run
from zenoh_cbef.nodes.recorder import Status, run_recorder


def _record(
    run: Run,
    output: Annotated[Path, typer.Option("--output", "-o", help="The log to write.")] = Path("run.mcap"),
    connect: Connect = None,
    listen: Listen = None,
    gossip: Gossip = True,
    client: Client = False,
    config: Config = None,
    lease_ms: Lease = 5000,
    patience: Patience = 5.0,
    sync: Annotated[bool, typer.Option("--sync", help="Flush to the disk, not only to the system.")] = False,
    status_json: Annotated[bool, typer.Option("--status-json", hidden=True)] = False,
) -> None:
    """Record all traffic of a run into an MCAP log until the run ends."""

    def report(status: Status) -> None:
        if status_json:
            sys.stdout.write(json.dumps(asdict(status)) + "\n")
            sys.stdout.flush()
        elif sys.stderr.isatty():
            sys.stderr.write(f"\r{status.messages} messages, step {status.step} of {status.steps} ")

    connection = connection_of(connect, listen, gossip=gossip, client=client, config=config, lease_ms=lease_ms)
    identity = identity_of("record", "record", run, connection, patience)
    last = run_recorder(identity, output, sync=sync, report=report)
    if not status_json:
        typer.echo(f"{last.messages} messages in {output}, {last.missing} missing")


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("record")(_record)
