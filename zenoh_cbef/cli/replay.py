"""replay: a recorded run once more, for any subscriber."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.interrupts import INTERRUPTED
from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.joining import Joining, JoiningCommand, JoiningContext, identity_of
from zenoh_cbef.cli.options.shared import LONGEST_SECONDS, WHICH, Exclude, Include, LogFile
from zenoh_cbef.cli.run import run_processes
from zenoh_cbef.cli.terminal.console import tell_what_lacks
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.header import read_header
from zenoh_cbef.log.read.measurements import read_measurements
from zenoh_cbef.log.read.parts import find_log, open_log
from zenoh_cbef.log.tools.playlist import Selection
from zenoh_cbef.log.tools.selection import select
from zenoh_cbef.nodes.replay.player import PlayerState
from zenoh_cbef.nodes.replay.replay import Playback, replay_run, run_replay
from zenoh_cbef.numbers import number
from zenoh_cbef.protocol.session import PORT, Connection
from zenoh_cbef.words import counted


class Destination(StrEnum):
    """Where the recorded messages go."""

    network = "network"
    agents = "agents"


To = Annotated[
    Destination, typer.Option("--to", help="network: all messages, to subscribers. agents: the beacons, to new agents.")
]
Settings = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="With --to agents: as for reestimate.")
]
Output = Annotated[
    Path | None, typer.Option("--output", "-o", help="With --to agents: the log; default: a folder in logs/.")
]
Rate = Annotated[float, typer.Option("--rate", "-r", min=1e-6, max=1e6, help="How many times real time.")]
Loop = Annotated[bool, typer.Option("--loop", "-l", help="Begin again at the end.")]
Offset = Annotated[
    float,
    typer.Option(
        min=0.0, max=LONGEST_SECONDS, metavar="S", rich_help_panel=WHICH, help="Begin this many s into the log."
    ),
]
Duration = Annotated[
    float | None,
    typer.Option(
        "--duration",
        "--playback-duration",
        min=0.0,
        max=LONGEST_SECONDS,
        metavar="S",
        rich_help_panel=WHICH,
        help="Play this many s of the log.",
    ),
]
Topics = Annotated[
    list[str] | None,
    typer.Option(
        "--topics", metavar="KEYS", rich_help_panel=WHICH, help="Only these keys, as cbef/*/beacon/*; repeatable."
    ),
]
NotTopics = Annotated[
    list[str] | None,
    typer.Option("--exclude", metavar="KEYS", rich_help_panel=WHICH, help="Not these keys; repeatable."),
]
Regex = Annotated[
    list[str] | None,
    typer.Option("--regex", metavar="REGEX", rich_help_panel=WHICH, help="As -y, for a part of the topic; repeatable."),
]
NotRegex = Annotated[
    list[str] | None,
    typer.Option(
        "--exclude-regex", metavar="REGEX", rich_help_panel=WHICH, help="As -n, for a part of the topic; repeatable."
    ),
]
Remap = Annotated[list[str] | None, typer.Option(metavar="OLD:=NEW", help="Call keys that begin with OLD otherwise.")]
Paused = Annotated[bool, typer.Option("--start-paused", "-p", help="Begin paused.")]
Delay = Annotated[
    float,
    typer.Option("--delay", "-d", min=0.0, max=LONGEST_SECONDS, help="Wait this many s before the first message."),
]
Wait = Annotated[bool, typer.Option("--wait", help="Wait for a subscriber first.")]
Linger = Annotated[
    float, typer.Option(min=0.0, max=LONGEST_SECONDS, help="Stay at most this many s for subscribers that are behind.")
]
Keys = Annotated[bool, typer.Option(help="Obey the keys space, right, n, up and down.")]


def _replay(
    ctx: JoiningContext,
    log: LogFile = Path("logs/latest"),
    to: To = Destination.network,
    overrides: Settings = None,
    output: Output = None,
    rate: Rate = 1.0,
    loop: Loop = False,
    start_offset: Offset = 0.0,
    duration: Duration = None,
    include: Include = None,
    exclude: Exclude = None,
    topics: Topics = None,
    not_topics: NotTopics = None,
    regex: Regex = None,
    not_regex: NotRegex = None,
    remap: Remap = None,
    start_paused: Paused = False,
    delay: Delay = 0.0,
    wait: Wait = False,
    linger: Linger = 1.0,
    keyboard: Keys = True,
) -> None:
    """Publish a recorded run again, with its timing and byte for byte, so that any subscriber sees it live.

    With --to agents: start new agents as processes, with another filter or parameters, on the recorded beacons.
    """
    if to is Destination.agents:
        _to_agents(log, overrides or (), output)
        return
    if overrides or output:
        raise UserError("--set and --output are for --to agents: what is published is what was recorded")
    whole = select(include or (), exclude or ())
    selection = Selection(
        topics or (), not_topics or (), whole.include, whole.exclude, regex or (), not_regex or (), remap or ()
    )
    how = Playback(
        rate=rate,
        loop=loop,
        start_offset=start_offset,
        duration=duration,
        start_paused=start_paused,
        delay=delay,
        wait=wait,
        linger=linger,
        keyboard=keyboard,
    )
    _to_network(log, _connection(ctx.joining), selection, how)


def _connection(joining: Joining) -> Connection:
    """As the command line says; where it names no endpoint, the replay listens on this host."""
    connection = joining.connection("replay")
    if joining.client or joining.connect or joining.listen or joining.config:
        return connection
    return replace(connection, listen=[connection.loopback(PORT)])


def _to_network(log: Path, connection: Connection, selection: Selection, how: Playback) -> None:
    file = open_log(log)
    header = read_header(file)
    identity = identity_of("replay", "replay", replay_run(header.run, selection), connection, 0.0)
    state, ended = run_replay(identity, file, selection, how, _show)
    if sys.stderr.isatty():
        sys.stderr.write("\n")
    typer.echo(f"{counted(state.published, 'message')} of run {header.run} published")
    if not ended:
        raise typer.Exit(INTERRUPTED)


def _to_agents(log: Path, overrides: Sequence[str], output: Path | None) -> None:
    found = read_measurements(log)
    loaded = found.loaded(overrides)
    tell_what_lacks(found.lacks())
    settings = [part for one in overrides for part in ("--set", one)]
    name = f"{found.header.run}-{loaded.scenario.filter.kind}"
    run_processes(["--beacons", str(find_log(log).resolve()), *settings], loaded, name, output, report=False)


def _show(state: PlayerState) -> None:
    if sys.stderr.isatty():
        lap = f"  lap {state.lap}" if state.lap > 1 else ""
        times = f"{state.position:.1f} of {state.duration:.1f} s"
        sys.stderr.write(f"\r\x1b[K{times}  {state.state} x{number(state.rate)}  {state.published} messages{lap}")
        sys.stderr.flush()


VERB = verb(_replay, "replay logs/latest --rate 2 -y '.*/estimate'", JoiningCommand)
