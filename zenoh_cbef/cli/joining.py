"""What agent, target and record have in common: how a process joins a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.node import Identity
from zenoh_cbef.protocol.session import Connection

Gossip = Annotated[bool, typer.Option(help="Let peers tell each other about third ones.")]
Client = Annotated[bool, typer.Option("--client", help="Join through a router instead of peer to peer.")]
Config = Annotated[str | None, typer.Option("--config", metavar="FILE", help="A Zenoh configuration file.")]
Lease = Annotated[int, typer.Option(min=100, help="How long a silent link is taken to be alive.")]
Patience = Annotated[float, typer.Option(min=0.1, help="Seconds to wait for the others to appear.")]


def connection_of(
    connect: Sequence[str] | None,
    listen: Sequence[str] | None,
    *,
    gossip: bool,
    client: bool,
    config: str | None,
    lease_ms: int,
) -> Connection:
    """The connection that a command line describes."""
    return Connection(
        connect=connect or (),
        listen=listen or (),
        mode="client" if client else "peer",
        gossip=gossip,
        lease_ms=lease_ms,
        config=config,
    )


def identity_of(role: str, name: str, run: str, connection: Connection, patience: float) -> Identity:
    """Which process of which run this is. Raises UserError for a bad run name or a missing endpoint."""
    if not run or not all(part.isalnum() or part in "._-" for part in run):
        raise UserError(f"--run {run!r} is no run name; use letters, digits, dot, dash and underscore")
    if role != "target" and not connection.connect and not connection.listen and connection.config is None:
        raise UserError(f"{role} needs an endpoint of the run, as in --connect tcp/127.0.0.1:7447")
    return Identity(run, role, name, connection, patience)
