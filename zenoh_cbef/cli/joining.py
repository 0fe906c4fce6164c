"""The options of every verb that joins a run: whom to link to, and how to prove who one is."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from zenoh_cbef.cli.names import checked
from zenoh_cbef.cli.options import LONGEST_SECONDS, Connect, listening
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.common.node import Identity
from zenoh_cbef.protocol.session import Connection
from zenoh_cbef.protocol.tls import Tls

Patience = Annotated[
    float, typer.Option(min=0.1, max=LONGEST_SECONDS, help="Seconds to wait for the others to appear.")
]
_Gossip = Annotated[bool, typer.Option(help="Let peers tell each other about third ones.")]
_Client = Annotated[bool, typer.Option("--client", help="Join through a router instead of peer to peer.")]
_Config = Annotated[str | None, typer.Option("--config", metavar="FILE", help="A Zenoh configuration file.")]
_Lease = Annotated[int, typer.Option(min=100, max=600_000, help="How long a silent link is taken to be alive.")]
_Folder = Annotated[
    Path | None, typer.Option("--tls", metavar="DIR", help="Certificates of 'certs new'; links without are refused.")
]
_Ca = Annotated[
    Path | None, typer.Option("--ca", metavar="FILE", help="Instead of --tls: the authority's certificate.")
]
_Cert = Annotated[Path | None, typer.Option("--cert", metavar="FILE", help="And this process's own.")]
_Key = Annotated[Path | None, typer.Option("--key", metavar="FILE", help="And its private key.")]


@dataclass(frozen=True)
class Joining:
    """What the command line says about joining a run."""

    connect: Connect = None
    listen: list[str] | None = None
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
            return Tls(self.ca, self.cert, self.key)
        if self.ca is not None or self.cert is not None or self.key is not None:
            raise UserError("--ca, --cert and --key belong together; give all three, or --tls DIR alone")
        return None if self.tls is None else Tls.of_folder(self.tls, certificate)


def joins(verb: Callable[..., None], *, port: int = 0) -> Callable[..., None]:
    """Give a verb that takes a `joining` the options of Joining; port: where it listens by default, 0 for any."""
    hints = get_type_hints(Joining, include_extras=True) | {"listen": listening(port)}
    keyword = inspect.Parameter.KEYWORD_ONLY
    shared = [
        inspect.Parameter(field.name, keyword, default=field.default, annotation=hints[field.name])
        for field in fields(Joining)
    ]
    own = inspect.signature(verb, eval_str=True).parameters.values()

    @wraps(verb)
    def command(**options: Any) -> None:
        joining = Joining(**{parameter.name: options.pop(parameter.name) for parameter in shared})
        verb(**options, joining=joining)

    kept = [one.replace(kind=keyword) for one in own if one.name != "joining"]
    command.__signature__ = inspect.Signature([*kept, *shared])  # type: ignore[attr-defined]
    command.__annotations__ = {one.name: one.annotation for one in (*kept, *shared)}
    return command


def identity_of(role: str, name: str, run: str, connection: Connection, patience: float) -> Identity:
    """Which process of which run this is. Raises UserError for a bad name or a missing endpoint."""
    checked(run, "--run")
    checked(name, "--name")
    if role != "target" and not connection.connect and not connection.listen and connection.config is None:
        raise UserError(f"{role} needs an endpoint of the run, as in --connect tcp/127.0.0.1:7447")
    warn_of_exposure(connection)
    return Identity(run, role, name, connection, patience)


def warn_of_exposure(connection: Connection) -> None:
    """Say once that others can listen in, where they can."""
    if connection.exposed:
        sys.stderr.write(
            f"warning: {', '.join(connection.exposed)} can be reached from other hosts, and without --tls everybody "
            "there can read and forge messages\n"
        )
