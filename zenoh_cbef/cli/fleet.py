"""fleet: many agents of a run as processes of one host."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.interrupts import INTERRUPTED
from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.calling.stops import StopRequests
from zenoh_cbef.cli.options.joining import Joining, JoiningCommand, JoiningContext, Patience, warn_of_exposure
from zenoh_cbef.cli.options.shared import Run, Stay
from zenoh_cbef.cli.terminal.console import tell
from zenoh_cbef.cli.terminal.ids import ids_of, shortened
from zenoh_cbef.cli.terminal.one_line import OneLine
from zenoh_cbef.errors import UserError
from zenoh_cbef.machine import require
from zenoh_cbef.nodes.launch.fleet import Fleet, Member, missing
from zenoh_cbef.nodes.launch.host_recorder import HostRecorder
from zenoh_cbef.protocol.addresses import parts
from zenoh_cbef.protocol.shares import share_keys, share_name
from zenoh_cbef.words import counted


class _Display:
    """One line on a terminal, else a line every few seconds in which something changed."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet, self._members, self._line = fleet, fleet.members, OneLine()

    def show(self) -> None:
        """Show how many of the processes are where, and what happened to some."""
        while self._fleet.news:
            self._line.close()
            tell(self._fleet.news.pop(0))
        counts = dict.fromkeys(("joined", "began", "ended"), 0)
        for member in self._members:
            if member.stage in counts:
                counts[member.stage] += 1
        here = f"{counts['joined'] + counts['began']} in the run, {counts['began']} under way, {counts['ended']} ended"
        again = sum(max(0, member.starts - 1) for member in self._members)
        lost = sum(bool(member.why) for member in self._members)
        words = f"{here}, {again} restarted" * bool(again) or here
        words += f", {lost} missing" if lost else ""
        self._line.show(words)

    def close(self) -> None:
        """Leave the line."""
        self._line.close()


def _fleet(
    ids: Annotated[str, typer.Argument(metavar="IDS", help="Which agents, as in 0-49 or 0,3,5-9.")],
    run: Run,
    ctx: JoiningContext,
    patience: Patience = 60.0,
    record: Annotated[
        Path | None,
        typer.Option(
            "--record", metavar="FILE", help="Also record these agents, with target and faults, into this log."
        ),
    ] = None,
    stay: Stay = 0.0,
    restart: Annotated[bool, typer.Option("--restart/--no-restart", help="Start agents that die again.")] = True,
) -> None:
    """Run many agents of this host, each a process: start, watch and restart them. Ctrl-C ends them all."""
    agents = ids_of(ids)
    joining = ctx.joining
    if joining.cert is not None or joining.key is not None:
        raise UserError("--cert and --key are of one agent; give --tls with the folder that has those of all")
    connection = joining.connection(f"agent-{agents[0]}")
    warn_of_exposure(connection)
    require(links=1, processes=len(agents), forked=True)
    shared = ["--run", run, "--patience", str(patience), "--status-json", *_options(joining)]
    commands = {agent: ["agent", str(agent), *shared, *_listen(joining, place)] for place, agent in enumerate(agents)}
    recorder = HostRecorder(_recording(joining, agents, record, stay, shared)) if record else nullcontext()
    with StopRequests() as stops, recorder as recording, Fleet(commands, restart=restart) as fleet:
        display = _Display(fleet)
        tell(f"run {run}: {counted(len(agents), 'agent')} on this host")
        try:
            fleet.watch(display.show, stops)
        finally:
            display.close()
        recorded = recording is None or recording.wait(stops) == 0
    _conclude(run, fleet.members, interrupted=stops.count > 0)
    if not recorded:
        raise typer.Exit(1)


def _recording(joining: Joining, agents: Sequence[int], log: Path, stay: float, shared: Sequence[str]) -> list[str]:
    """The command line of the recorder of these agents; it listens on the port after theirs."""
    keys = [part for one in share_keys(agents) for part in ("--keys", one)]
    name = ["--name", share_name(shortened(agents)), "--output", str(log), "--stay", str(stay)]
    own = [one for one in shared if one != "--status-json"]
    return ["record", *name, *keys, *own, *_listen(joining, len(agents))]


def _options(joining: Joining) -> list[str]:
    found = [] if joining.gossip else ["--no-gossip"]
    found += ["--client"] if joining.client else []
    found += ["--lease-ms", str(joining.lease_ms)]
    for name, value in (("--config", joining.config), ("--tls", joining.tls)):
        found += [] if value is None else [name, str(Path(value).absolute())]
    return [*found, *(part for one in joining.connect or () for part in ("--connect", one))]


def _listen(joining: Joining, place: int) -> list[str]:
    """Where the agent at this place of the list listens: where a port is named, each takes the next one."""
    found = []
    for endpoint in joining.listen or ():
        port = parts(endpoint)[2]
        own = endpoint if port < 1 else f"{endpoint.rpartition(':')[0]}:{port + place}"
        found += ["--listen", own]
    return found


def _conclude(run: str, members: Sequence[Member], *, interrupted: bool) -> None:
    """Say what became of them, and exit with 1 where some are missing, with 2 where the run refused them all."""
    ended: dict[int, list[int]] = {}
    for member in members:
        if not member.why and member.stage == "ended":
            ended.setdefault(member.step, []).append(member.agent)
    for step, ids in sorted(ended.items()):
        typer.echo(f"{_named(ids)} ended " + (f"after step {step}" if step else f"before run {run} had begun"))
    if again := [member.agent for member in members if member.starts > 1]:
        times = sum(member.starts - 1 for member in members if member.starts)
        typer.echo(f"{_named(again)} had to be started again, {counted(times, 'time')} in all")
    reasons = missing(members)
    for why, ids in reasons.items():
        tell(f"{_named(ids)}: {why}")
    if interrupted:
        raise typer.Exit(INTERRUPTED)
    if reasons:
        raise typer.Exit(2 if all(member.refused for member in members) else 1)


def _named(ids: Sequence[int]) -> str:
    return f"agent {ids[0]}" if len(ids) == 1 else f"agents {shortened(ids)}"


VERB = verb(_fleet, "fleet 0-49 --run mine --connect tcp/192.0.2.1:7447", JoiningCommand)
