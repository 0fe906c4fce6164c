"""agent, target, record: one process of a run each."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.options import Connect, Listen, Overrides, Run, ScenarioName
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.node import Identity
from zenoh_cbef.protocol.session import Connection

Gossip = Annotated[bool, typer.Option(help="Let peers tell each other about third ones.")]
Client = Annotated[bool, typer.Option("--client", help="Join through a router instead of peer to peer.")]
Config = Annotated[str | None, typer.Option("--config", metavar="FILE", help="A Zenoh configuration file.")]
Lease = Annotated[int, typer.Option(help="How long a silent link is taken to be alive.")]
Patience = Annotated[float, typer.Option(min=0.1, help="Seconds to wait for the others to appear.")]


def _identity(
    role: str,
    name: str,
    run: str,
    connection: Connection,
    patience: float,
) -> Identity:
    if not run or not all(part.isalnum() or part in "._-" for part in run):
        raise UserError(f"--run {run!r} is no run name; use letters, digits, dot, dash and underscore")
    if role != "target" and not connection.connect and not connection.listen and connection.config is None:
        raise UserError(f"{role} needs an endpoint of the run, as in --connect tcp/127.0.0.1:7447")
    return Identity(run, role, name, connection, patience)


def _agent(
    agent: Annotated[int, typer.Argument(metavar="ID", min=0, help="Which agent of the scenario to be.")],
    run: Run,
    connect: Connect = None,
    listen: Listen = None,
    gossip: Gossip = True,
    client: Client = False,
    config: Config = None,
    lease_ms: Lease = 5000,
    patience: Patience = 5.0,
) -> None:
    """Run one agent process; it fetches the scenario from the run's target."""
    from zenoh_cbef.nodes.agent import run_agent

    connection = Connection(connect or (), listen or (), "client" if client else "peer", gossip, False, lease_ms, config)
    last = run_agent(_identity("agent", str(agent), run, connection, patience))
    typer.echo(f"agent {agent} ended after step {last}")


def _target(
    scenario: ScenarioName = "tracking",
    run: Annotated[str | None, typer.Option("--run", help="The run's name; default: the scenario's.")] = None,
    overrides: Overrides = None,
    connect: Connect = None,
    listen: Listen = None,
    gossip: Gossip = True,
    client: Client = False,
    config: Config = None,
    lease_ms: Lease = 5000,
    patience: Patience = 60.0,
) -> None:
    """Run the target process: it serves the scenario, waits for the agents, and emits the beacons."""
    from zenoh_cbef.nodes.target import run_target
    from zenoh_cbef.scenario.checks import check
    from zenoh_cbef.scenario.load import load

    loaded = load(scenario, overrides or ())
    for warning in check(loaded.scenario):
        sys.stderr.write(f"warning: {warning}\n")
    zenoh = loaded.scenario.zenoh
    connection = Connection(
        connect or zenoh.connect,
        listen or zenoh.listen or ("tcp/127.0.0.1:7447",),
        "client" if client else zenoh.mode,
        gossip and zenoh.gossip,
        zenoh.multicast,
        lease_ms,
        config or zenoh.config,
    )
    name = run or loaded.scenario.name
    if sys.stderr.isatty():
        sys.stderr.write(f"run {name}: waiting for {loaded.scenario.count} agents on {', '.join(connection.listen)}\n")
    last = run_target(_identity("target", "target", name, connection, patience), loaded)
    typer.echo(f"the target ended after step {last}")


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
    from zenoh_cbef.nodes.recorder import Status, run_recorder

    def report(status: Status) -> None:
        if status_json:
            print(json.dumps(asdict(status)), flush=True)
        elif sys.stderr.isatty():
            sys.stderr.write(f"\r{status.messages} messages, step {status.step} of {status.steps} ")

    connection = Connection(connect or (), listen or (), "client" if client else "peer", gossip, False, lease_ms, config)
    last = run_recorder(_identity("record", "record", run, connection, patience), output, sync=sync, report=report)
    if not status_json:
        typer.echo(f"{last.messages} messages in {output}, {last.missing} missing")


def register(app: typer.Typer) -> None:
    """Add the verbs."""
    app.command("agent")(_agent)
    app.command("target")(_target)
    app.command("record")(_record)
