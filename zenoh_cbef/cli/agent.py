"""agent: one agent process."""

from __future__ import annotations

from typing import Annotated

import typer

from zenoh_cbef.cli.joining import Client, Config, Gossip, Lease, Patience, connection_of, identity_of
from zenoh_cbef.cli.options import Connect, Listen, Run
from zenoh_cbef.nodes.agent import run_agent


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
    connection = connection_of(connect, listen, gossip=gossip, client=client, config=config, lease_ms=lease_ms)
    last = run_agent(identity_of("agent", str(agent), run, connection, patience))
    typer.echo(f"agent {agent} ended after step {last}")


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("agent")(_agent)
