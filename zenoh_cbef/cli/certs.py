"""certs: certificates for a run's processes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import group
from zenoh_cbef.protocol.certificates import make_certificates
from zenoh_cbef.protocol.tls import common_name
from zenoh_cbef.quantities import MOST_AGENTS

_ROLES = ("target", "record", "router", "receiver", "operator")
_LOCAL = ("localhost", "127.0.0.1", "::1")


def _new(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The folder that they go into.")],
    agents: Annotated[int, typer.Option(min=0, max=MOST_AGENTS, help="For how many agents.")] = 6,
    hosts: Annotated[
        list[str] | None,
        typer.Option("--host", help="A name or address that processes are reached by, besides loopback; repeatable."),
    ] = None,
    replay: Annotated[
        bool, typer.Option("--replay", help="Also for replay, which sends in the names of all processes.")
    ] = False,
    days: Annotated[int, typer.Option(min=1, max=36_500, help="How long they are valid.")] = 365,
) -> None:
    """Make a test authority, and a certificate and key for each role and agent; what is there stays."""
    names = [*_ROLES, *(["replay"] if replay else []), *(common_name("agent", str(agent)) for agent in range(agents))]
    made = make_certificates(folder, names, hosts=[*_LOCAL, *(hosts or ())], days=days)
    typer.echo(f"{folder}: {', '.join(made) or 'nothing was missing'}")
    typer.echo(f"give each host ca.pem and its processes' .pem and .key files; {folder / 'ca.key'} stays here")


VERB = group(
    "Certificates for mutual TLS.",
    {
        "certs new certificates --agents 12 --host 192.0.2.1": _new,
    },
)
