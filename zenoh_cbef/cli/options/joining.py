"""The options of every verb that joins a run: its links, and its certificate."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperArgument, TyperCommand, TyperOption

from zenoh_cbef.cli.options.shared import LONGEST_SECONDS
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.common.node import Identity
from zenoh_cbef.protocol.names import checked
from zenoh_cbef.protocol.session import Connection
from zenoh_cbef.protocol.tls import Tls

_PANEL = "Options of every verb that joins a run"
Patience = Annotated[
    float, typer.Option(min=0.1, max=LONGEST_SECONDS, help="Seconds to wait for the others to appear.")
]
_Connect = Annotated[
    list[str] | None,
    typer.Option("--connect", metavar="ENDPOINT", help="Link to this endpoint, as tcp/HOST:PORT; repeatable."),
]
_Listen = Annotated[
    list[str] | None,
    typer.Option(
        "--listen",
        metavar="ENDPOINT",
        help="Accept links there; default: a loopback port, 7447 for target, router and replay, else a free one.",
    ),
]
_Gossip = Annotated[bool, typer.Option(help="Let the target tell which other processes to link to.")]
_Client = Annotated[bool, typer.Option("--client", help="Join through a router instead of peer to peer.")]
_Config = Annotated[str | None, typer.Option("--config", metavar="FILE", help="A Zenoh configuration file.")]
_Lease = Annotated[
    int, typer.Option(min=100, max=600_000, metavar="MS", help="When a silent link counts as broken, ms.")
]
_Folder = Annotated[
    Path | None,
    typer.Option("--tls", metavar="DIR", help="A folder of 'certs new'; links without a certificate are refused."),
]
_Ca = Annotated[
    Path | None, typer.Option("--ca", metavar="FILE", help="Instead of --tls: the authority's certificate.")
]
_Cert = Annotated[Path | None, typer.Option("--cert", metavar="FILE", help="With --ca: this process's certificate.")]
_Key = Annotated[Path | None, typer.Option("--key", metavar="FILE", help="With --ca: its private key.")]


@dataclass(frozen=True)
class Joining:
    """What the command line says about joining a run."""

    connect: _Connect = None
    listen: _Listen = None
    gossip: _Gossip = True
    client: _Client = False
    config: _Config = None
    lease_ms: _Lease = 5000
    tls: _Folder = None
    ca: _Ca = None
    cert: _Cert = None
    key: _Key = None

    def connection(self, certificate: str, *, mode: str = "peer") -> Connection:
        """The connection of the process whose certificate has this common name."""
        return Connection(
            connect=self.connect or (),
            listen=self.listen or (),
            mode="client" if self.client else mode,
            gossip=self.gossip,
            lease_ms=self.lease_ms,
            config=self.config,
            tls=self._tls(certificate),
        )

    def _tls(self, certificate: str) -> Tls | None:
        if self.ca is not None and self.cert is not None and self.key is not None:
            found = Tls(self.ca, self.cert, self.key)
        elif self.ca is not None or self.cert is not None or self.key is not None:
            raise UserError("--ca, --cert and --key belong together; give all three, or --tls DIR alone")
        elif self.tls is None:
            return None
        else:
            found = Tls.of_folder(self.tls, certificate)
        if told := found.check_dates(datetime.now(UTC)):
            sys.stderr.write(f"warning: {told}\n")
        return found


def _options() -> list[TyperOption]:
    """What the command line takes for the fields of Joining."""
    app = typer.Typer(add_completion=False)
    app.command()(Joining)
    options = [one for one in typer.main.get_command(app).params if isinstance(one, TyperOption)]
    for option in options:
        option.rich_help_panel = _PANEL
    return options


class JoiningContext(typer.Context):
    """The context of a verb that joins a run."""

    joining: Joining


class JoiningCommand(TyperCommand):
    """A verb that joins a run: it has, after its own options, those of Joining, and a JoiningContext tells them."""

    context_class = JoiningContext
    shared = _options()

    def __init__(self, *, params: Sequence[TyperArgument | TyperOption], **settings: Any) -> None:
        super().__init__(params=[*params, *self.shared], **settings)

    def invoke(self, ctx: Any) -> Any:
        """Run the verb."""
        ctx.joining = Joining(**{option.name: ctx.params.pop(option.name) for option in self.shared})
        return super().invoke(ctx)


def identity_of(role: str, name: str, run: str, connection: Connection, patience: float) -> Identity:
    """The process of a run that these options describe. Raises UserError for a bad name or a missing endpoint."""
    checked(run, "--run")
    checked(name, "--name")
    if role != "target" and not connection.connect and not connection.listen and connection.config is None:
        raise UserError(f"{role} needs an endpoint of the run, as in --connect tcp/127.0.0.1:7447")
    warn_of_exposure(connection)
    return Identity(run, role, name, connection, patience)


def warn_of_exposure(connection: Connection) -> None:
    """Warn of endpoints that other hosts reach without a certificate."""
    if connection.exposed:
        sys.stderr.write(
            f"warning: {', '.join(connection.exposed)} can be reached from other hosts, and without --tls every "
            "program there can read and forge messages\n"
        )
