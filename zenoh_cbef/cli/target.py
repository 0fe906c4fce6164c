"""target: the target process."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.joining import Client, Config, Gossip, Lease, Patience, connection_of, identity_of
from zenoh_cbef.cli.options import Connect, Listen, Overrides, ScenarioName
from zenoh_cbef.log.measurements import read_measurements
from zenoh_cbef.nodes.target import run_target
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load

_LISTEN = ("tcp/127.0.0.1:7447",)


def _target(
    scenario: ScenarioName = "tracking",
    run: Annotated[str | None, typer.Option("--run", help="The run's name; default: the scenario's.")] = None,
    overrides: Overrides = None,
    beacons: Annotated[
        Path | None,
        typer.Option("--beacons", metavar="LOG", help="Emit the beacons of a log; the scenario is the log's, too."),
    ] = None,
    connect: Connect = None,
    listen: Listen = None,
    gossip: Gossip = True,
    client: Client = False,
    config: Config = None,
    lease_ms: Lease = 5000,
    patience: Patience = 60.0,
) -> None:
    """Run the target process: it serves the scenario, waits for the agents, and emits the beacons."""
    world = None
    if beacons is None:
        loaded = load(scenario, overrides or ())
    else:
        found = read_measurements(beacons)
        loaded = found.loaded(overrides or ())
        world = found.world(loaded.scenario)
    for warning in check(loaded.scenario):
        sys.stderr.write(f"warning: {warning}\n")
    zenoh = loaded.scenario.zenoh
    connection = connection_of(
        connect or zenoh.connect,
        listen or zenoh.listen or (() if client else _LISTEN),
        gossip=gossip and zenoh.gossip,
        client=client or zenoh.mode == "client",
        config=config or zenoh.config,
        lease_ms=lease_ms,
    )
    name = run or loaded.scenario.name
    identity = identity_of("target", "target", name, replace(connection, multicast=zenoh.multicast), patience)
    if sys.stderr.isatty():
        sys.stderr.write(f"run {name}: waiting for {loaded.scenario.count} agents on {', '.join(connection.listen)}\n")
    last = run_target(identity, loaded, world)
    typer.echo(f"the target ended after step {last}")


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("target")(_target)
