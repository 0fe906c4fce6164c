"""replay: a recorded run once more, for any subscriber."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.joining import Client, Config, Gossip, Lease, connection_of, identity_of
from zenoh_cbef.cli.options import Connect, Listen, LogFile
from zenoh_cbef.cli.tables import number
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.contents import open_log, read_header
from zenoh_cbef.log.playlist import Selection
from zenoh_cbef.nodes.player import PlayerState
from zenoh_cbef.nodes.replay import Playback, replay_run, run_replay

_INTERRUPTED = 130
_LISTEN = ("tcp/127.0.0.1:7447",)

Patterns = list[str] | None


def _replay(
    log: LogFile = Path("logs/latest"),
    rate: Annotated[float, typer.Option("--rate", "-r", help="How many times real time.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", "-l", help="Begin again at the end.")] = False,
    start_offset: Annotated[float, typer.Option(min=0.0, help="Begin this many s into the log.")] = 0.0,
    duration: Annotated[
        float | None, typer.Option("--duration", "--playback-duration", min=0.0, help="Play this many s of the log.")
    ] = None,
    topics: Annotated[Patterns, typer.Option(help="Play these keys only, as cbef/*/beacon/*; repeatable.")] = None,
    exclude: Annotated[Patterns, typer.Option(help="Leave these keys out; repeatable.")] = None,
    regex: Annotated[Patterns, typer.Option("--regex", "-y", help="Play keys that match; repeatable.")] = None,
    exclude_regex: Annotated[Patterns, typer.Option("--exclude-regex", "-n", help="Leave out keys that match.")] = None,
    remap: Annotated[
        Patterns, typer.Option(metavar="OLD:=NEW", help="Call keys that begin with OLD otherwise; repeatable.")
    ] = None,
    start_paused: Annotated[bool, typer.Option("--start-paused", "-p", help="Begin paused.")] = False,
    delay: Annotated[float, typer.Option("--delay", "-d", min=0.0, help="Wait this many s before the first.")] = 0.0,
    wait: Annotated[bool, typer.Option("--wait", help="Wait for a subscriber first.")] = False,
    linger: Annotated[float, typer.Option(min=0.0, help="Stay at most this many s for subscribers behind.")] = 1.0,
    keyboard: Annotated[bool, typer.Option(help="Obey the keys space, right, n, up and down.")] = True,
    connect: Connect = None,
    listen: Listen = None,
    gossip: Gossip = True,
    client: Client = False,
    config: Config = None,
    lease_ms: Lease = 5000,
) -> None:
    """Publish a recorded run again, with its timing and byte for byte, so that any subscriber sees it live."""
    file = open_log(log)
    header = read_header(file, log)
    if not 0.0 < rate < 1e6:
        raise UserError(f"--rate {rate:g} cannot be played; give a number above 0 and below 1000000")
    selection = Selection(topics or (), exclude or (), regex or (), exclude_regex or (), remap or ())
    usual = () if connect or client or config else _LISTEN
    connection = connection_of(connect, listen or usual, gossip=gossip, client=client, config=config, lease_ms=lease_ms)
    identity = identity_of("replay", "replay", replay_run(header.run, selection), connection, 0.0)
    how = Playback(rate, loop, start_offset, duration, start_paused, delay, wait, linger, keyboard)
    state, ended = run_replay(identity, file, selection, how, _show)
    if sys.stderr.isatty():
        sys.stderr.write("\n")
    typer.echo(f"{state.published} messages of run {header.run} published")
    if not ended:
        raise typer.Exit(_INTERRUPTED)


def _show(state: PlayerState) -> None:
    if sys.stderr.isatty():
        lap = f"  lap {state.lap}" if state.lap > 1 else ""
        times = f"{state.position:.1f} of {state.duration:.1f} s"
        sys.stderr.write(f"\r\x1b[K{times}  {state.state} x{number(state.rate)}  {state.published} messages{lap}")
        sys.stderr.flush()


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("replay")(_replay)
