"""target: the target process."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.joining import Joining, JoiningCommand, JoiningContext, Patience, identity_of
from zenoh_cbef.cli.options.shared import Overrides, ScenarioName
from zenoh_cbef.cli.terminal.one_line import OneLine
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.measurements import read_measurements
from zenoh_cbef.nodes.target.process import run_target
from zenoh_cbef.protocol.names import check_run
from zenoh_cbef.protocol.session import PORT, Connection
from zenoh_cbef.quantities import MOST_AGENTS
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.model import Zenoh
from zenoh_cbef.words import counted


def _connection(joining: Joining, zenoh: Zenoh) -> Connection:
    """The command line's connection, and what it leaves open as the scenario has it."""
    connection = replace(
        joining,
        connect=joining.connect or list(zenoh.connect),
        listen=joining.listen or list(zenoh.listen),
        gossip=joining.gossip and zenoh.gossip,
        client=joining.client or zenoh.mode == "client",
        config=joining.config or zenoh.config,
        tls=joining.tls or (None if zenoh.tls is None else Path(zenoh.tls)),
    ).connection("target")
    listen = connection.listen or (() if connection.mode == "client" else (connection.loopback(PORT),))
    return replace(connection, listen=listen, multicast=zenoh.multicast)


def _begun(line: OneLine, words: str, connection: Connection) -> Callable[[str], None] | None:
    """On a terminal say where the run is; returns what shows on it how far that is."""
    if not line.over:
        return None
    sys.stderr.write(f"{words} {', '.join(connection.listen or connection.connect)}\n")
    return line.show


def _target(
    ctx: JoiningContext,
    scenario: ScenarioName = "tracking",
    run: Annotated[
        str | None, typer.Option("--run", callback=check_run, help="The run's name; default: the scenario's.")
    ] = None,
    overrides: Overrides = None,
    beacons: Annotated[
        Path | None,
        typer.Option("--beacons", metavar="LOG", help="Emit the beacons of a log; the scenario is the log's, too."),
    ] = None,
    wait_for: Annotated[
        int | None,
        typer.Option(
            "--wait-for",
            min=1,
            max=MOST_AGENTS,
            help="Start when so many agents are ready, in realtime; others may join later.",
        ),
    ] = None,
    receivers: Annotated[
        bool, typer.Option("--receivers", help="Emit nothing: real receivers publish the beacons (docs/hosts.md).")
    ] = False,
    patience: Patience = 60.0,
) -> None:
    """Run the target process: it serves the scenario, waits for the agents, and emits the beacons."""
    world = None
    if beacons is None:
        loaded = load(scenario, [*(["sensor.real=true"] if receivers else []), *(overrides or ())])
    else:
        found = read_measurements(beacons)
        loaded = found.loaded(overrides or ())
        world = found.world(loaded.scenario)
    for warning in check(loaded.plan):
        sys.stderr.write(f"warning: {warning}\n")
    if wait_for is not None and loaded.scenario.timing.mode != "realtime":
        raise UserError(
            "--wait-for needs timing.mode = 'realtime': in lockstep the scenario says which agents take part"
        )
    if receivers and beacons is not None:
        raise UserError("--receivers and --beacons are two sources of the same beacons; leave one of them out")
    name = run or loaded.scenario.name
    connection = _connection(ctx.joining, loaded.scenario.zenoh)
    identity = identity_of("target", "target", name, connection, patience)
    with closing(OneLine()) as line:
        report = _begun(line, f"run {name}: {counted(loaded.scenario.count, 'agent')} to come to", connection)
        last = run_target(identity, loaded, world, receivers=receivers, wait_for=wait_for, report=report)
    typer.echo("the target ended " + (f"after step {last}" if last else f"before run {name} had begun"))


VERB = verb(_target, "target tracking --run mine --listen tcp/192.0.2.1:7447", JoiningCommand)
