"""receive: ranges of real receivers become beacons of a run."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from zenoh_cbef.cli.console import tell
from zenoh_cbef.cli.joining import JoiningCommand, JoiningContext, Patience, identity_of
from zenoh_cbef.cli.offer import verb
from zenoh_cbef.cli.options import Run
from zenoh_cbef.nodes.receiver.receiver import run_receiver


def _receive(
    source: Annotated[str, typer.Argument(help="serial:/dev/ttyUSB0[@RATE], udp:HOST:PORT or file:PATH.")],
    run: Run,
    ctx: JoiningContext,
    form: Annotated[
        Literal["auto", "csv", "json", "dwm1001"],
        typer.Option("--format", help="Lines of t,anchor,range; of JSON; or of a DWM1001's les and lec."),
    ] = "auto",
    name: Annotated[str, typer.Option("--name", help="This receiver's name, where a run has several.")] = "receiver",
    patience: Patience = 30.0,
) -> None:
    """Feed a run of 'target --receivers' with the ranges that a source tells, until the run is over."""
    identity = identity_of("receiver", name, run, ctx.joining.connection("receiver"), patience)
    heard = run_receiver(identity, source, form, tell)
    typer.echo(f"{heard.ranges} ranges, {heard.unknown} of unknown anchors, {heard.other} other lines")


VERB = verb(_receive, "receive udp:127.0.0.1:5005 --run live --connect tcp/127.0.0.1:7447", JoiningCommand)
