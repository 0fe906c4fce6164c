"""receive: ranges of real receivers become beacons of a run."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.joining import JoiningCommand, JoiningContext, Patience, identity_of
from zenoh_cbef.cli.options.shared import LONGEST_SECONDS, Run
from zenoh_cbef.cli.terminal.console import tell, warn
from zenoh_cbef.nodes.receiver.receiver import nothing_of, run_receiver


def _receive(
    source: Annotated[str, typer.Argument(help="serial:/dev/ttyUSB0[@RATE], udp:HOST:PORT or file:PATH.")],
    run: Run,
    ctx: JoiningContext,
    form: Annotated[
        Literal["auto", "csv", "json", "dwm1001", "linktrack", "mavlink"],
        typer.Option(
            "--format",
            help="auto: lines of t,anchor,range, of JSON, or of a DWM1001's les and lec. Nooploop LinkTrack frames and "
            "MAVLink need to be named.",
        ),
    ] = "auto",
    silence: Annotated[
        float,
        typer.Option(
            "--silence",
            min=0.1,
            max=LONGEST_SECONDS,
            help="In lockstep, go on with the last step after so many seconds without a byte.",
        ),
    ] = 2.0,
    name: Annotated[str, typer.Option("--name", help="This receiver's name, where a run has several.")] = "receiver",
    patience: Patience = 30.0,
) -> None:
    """Feed a run of 'target --receivers' with the ranges that a source tells, until the run is over."""
    identity = identity_of("receiver", name, run, ctx.joining.connection("receiver"), patience)
    heard = run_receiver(identity, source, form, silence, tell)
    late = f", {heard.late} too late for their step" if heard.late else ""
    typer.echo(f"{heard.ranges} ranges, {heard.unknown} of unknown anchors, {heard.other} other lines{late}")
    if not heard.ranges:
        warn([nothing_of(source, form, heard)])
        raise typer.Exit(1)


VERB = verb(_receive, "receive udp:127.0.0.1:5005 --run live --connect tcp/127.0.0.1:7447", JoiningCommand)
