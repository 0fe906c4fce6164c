"""run: the whole thing on this host."""

from __future__ import annotations

import os
import time
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.live import Live
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn

from zenoh_cbef.analysis.metrics import analyze, notes
from zenoh_cbef.analysis.outputs import REPORT, write_outputs
from zenoh_cbef.cli.calling.interrupts import INTERRUPTED
from zenoh_cbef.cli.calling.leash import follow_input
from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.calling.stops import StopRequests
from zenoh_cbef.cli.options.joining import warn_of_exposure
from zenoh_cbef.cli.options.places import beside
from zenoh_cbef.cli.options.shared import Overrides, ScenarioName
from zenoh_cbef.cli.terminal.beforehand import tell_beforehand
from zenoh_cbef.cli.terminal.console import console, errors, say, tell, tell_what_lacks
from zenoh_cbef.cli.terminal.results import metrics_table
from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import MissingExtra
from zenoh_cbef.log.common.naming import ACTIVE
from zenoh_cbef.log.read.parts import find_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.log.tools.collection import LATEST, place_of_log
from zenoh_cbef.machine import require
from zenoh_cbef.nodes.common.recording import Status
from zenoh_cbef.nodes.launch.attempts import launch
from zenoh_cbef.nodes.launch.launcher import Death, Launcher
from zenoh_cbef.numbers import number
from zenoh_cbef.outside.registry import refuse_what_goes_on
from zenoh_cbef.protocol.names import check_run
from zenoh_cbef.protocol.session import Connection
from zenoh_cbef.protocol.slow import REMEDY
from zenoh_cbef.protocol.tokens import in_words
from zenoh_cbef.scenario.load import Loaded, load, to_toml
from zenoh_cbef.scenario.size import refuse_a_trace_beyond_memory, refuse_too_many_processes
from zenoh_cbef.words import counted, first_of
from zenoh_cbef.writing import must_be_new

_ROOMY = 130
"""From this width on a terminal has room for all that is known of a run as it goes."""
_NAMED = 10
"""So many processes that do not keep up are named at once."""


class _Display:
    """The run as it goes: a bar on a terminal, a line now and then elsewhere."""

    def __init__(self, steps: int, agents: int) -> None:
        self._agents = agents
        columns: tuple[ProgressColumn, ...] = (
            TextColumn("step {task.completed:>6.0f} of {task.total:.0f}"),
            TextColumn("error {task.fields[error]}"),
            TextColumn("{task.fields[lost]} lost  {task.fields[late]} late"),
            TimeRemainingColumn(compact=True),
            TextColumn("{task.description}"),
        )
        if errors.width >= _ROOMY:  # A narrow terminal would cut numbers.
            more = TextColumn("{task.fields[rate]} steps/s"), TextColumn("{task.fields[messages]} messages")
            columns = (columns[0], BarColumn(bar_width=24), *more, *columns[1:])
        self._progress = Progress(*columns, console=errors)
        self._task = self._progress.add_task("", total=steps, rate="-", error="-", messages=0, lost=0, late=0)
        self._began: tuple[float, int] | None = None
        self._told, self._slow = time.monotonic(), set[str]()
        self._behind, self._failure, self.mourned = 0, "", list[Death]()
        self.live = Live(self._progress, console=errors, refresh_per_second=5, transient=True)

    def begin(self, endpoint: str) -> None:
        """Begin to be seen; not before the processes are started, who are forked where there is no other thread."""
        tell(f"target at {endpoint}; other programs join there as clients")
        self.live.start()

    def show(self, status: Status) -> None:
        """Take in one report of the recorder."""
        now = time.monotonic()
        if self._began is None and status.step > 0:
            self._began = now, status.step
        rate = None
        if self._began is not None and now > self._began[0]:
            rate = (status.step - self._began[1]) / (now - self._began[0])
        error, waits = number(status.error, "m"), self._waits(status)
        self._progress.update(
            self._task,
            description=waits,
            completed=status.step,
            messages=status.messages,
            lost=status.lost,
            late=status.late,
            rate=number(rate),
            error=error,
        )
        if slow := sorted({*status.slow} - self._slow, key=lambda one: (len(one), one)):
            self._slow.update(slow)
            names = first_of([in_words(one) for one in slow], _NAMED)
            tell(f"warning: {names} {'does' if len(slow) == 1 else 'do'} not keep up with real time; {REMEDY}")
        self._tell_of_recorder(status)
        if not errors.is_terminal and now - self._told > 5.0:
            self._told = now
            errors.print(waits or f"step {status.step} of {status.steps}, error {error}, {status.messages} messages")

    def _tell_of_recorder(self, status: Status) -> None:
        """Warn of what the recorder cannot do, each time that it begins."""
        if status.failure != self._failure:
            self._failure = status.failure
            tell(f"warning: the log lacks what comes from now on: {status.failure}")
        if status.behind > self._behind:
            self._behind = status.behind
            tell("warning: the recorder does not keep up, and what does not fit its mailbox is lost to the log")

    def mourn(self, death: Death) -> None:
        """Say at once that a process has died."""
        self.mourned.append(death)
        errors.print(f"[red]{escape(str(death))}[/red]", highlight=False, soft_wrap=True)

    def _waits(self, status: Status) -> str:
        """What a run that has not begun waits for; empty for one that has."""
        missing = self._agents - status.agents
        return f"waits for {missing} of {self._agents} agents" if missing > 0 and not status.began else ""


def _run(
    scenario: ScenarioName = "tracking",
    overrides: Overrides = None,
    log: Annotated[Path | None, typer.Option("--log", metavar="FILE", help="Where the log goes.")] = None,
    name: Annotated[
        str | None,
        typer.Option("--run", callback=check_run, help="The run's name; default: the scenario's and the time."),
    ] = None,
    report: Annotated[bool, typer.Option("--report/--no-report", help="Write report.html and figures.")] = True,
    sync: Annotated[
        bool, typer.Option("--sync", help="Flush the log to the disk itself, not only to the operating system.")
    ] = False,
    leashed: Annotated[bool, typer.Option("--leashed", hidden=True, help="End when standard input ends.")] = False,
) -> None:
    """Run a scenario on this host: target, agents and recorder as processes over Zenoh, then the analysis."""
    if leashed:
        follow_input()
    arguments = [scenario, *(part for one in overrides or () for part in ("--set", one))]
    loaded = load(scenario, overrides or ())
    run = name or f"{loaded.scenario.name}-{datetime.now().astimezone():%Y%m%d-%H%M%S}"
    run_processes(arguments, loaded, run, log, report=report, sync=sync)


def run_processes(
    arguments: list[str], loaded: Loaded, run: str, log: Path | None, *, report: bool, sync: bool = False
) -> None:
    """Run target, agents and recorder to their end, and analyse the log.

    arguments: what tells the target the scenario that `loaded` is. log: None for a folder of its own in logs/.
    """
    refuse_what_goes_on(run)
    refuse_too_many_processes(loaded.scenario)
    tell_beforehand(loaded.plan)
    refuse_a_trace_beyond_memory(loaded.plan)
    warn_of_exposure(Connection(listen=loaded.scenario.zenoh.listen))
    require(links=loaded.scenario.count + 1, processes=loaded.scenario.count + 2)
    with place_of_log(run, log) as path, StopRequests() as stops:
        must_be_new(path, "choose another --log, or move it away")
        name = path.parent.name if log is None else run
        if name != run:
            tell(f"note: logs/{run} exists; this run is {name!r}, for other verbs too")
        launcher = _execute(arguments, loaded, name, path, sync, stops)
    if not launcher.started:
        errors.print("stopped before the first step; nothing to analyse")
        raise typer.Exit(INTERRUPTED)
    if stops.count > 1:
        tell(f"ended at once; 'analyze {find_log(path)}' reads what was logged")
        raise typer.Exit(INTERRUPTED)
    _conclude(loaded, find_log(path), default=log is None, report=report)
    if stops.count:
        raise typer.Exit(INTERRUPTED)
    if launcher.deaths:
        raise typer.Exit(max(1, *(death.status for death in launcher.deaths)))


def _execute(arguments: list[str], loaded: Loaded, run: str, path: Path, sync: bool, stops: StopRequests) -> Launcher:
    """Run the processes; returns their launcher. Raises UserError where the run does not start."""
    display = _Display(loaded.scenario.length, loaded.scenario.count)
    tell(f"run {run}: {counted(loaded.scenario.count, 'agent')}, log {path}")
    try:
        launcher = launch(
            arguments,
            loaded,
            run,
            path,
            sync=sync,
            on_start=display.begin,
            on_status=display.show,
            on_death=display.mourn,
            asked_to_stop=stops,
        )
    finally:
        display.live.stop()
    if launcher.started or stops.count:
        # A user who stops a run that has not begun knows why its processes find no target.
        for death in launcher.deaths if launcher.started else ():
            if death not in display.mourned:
                display.mourn(death)
        return launcher
    mistakes = [death for death in launcher.deaths if death.status == 2]
    first = next(iter(mistakes or launcher.deaths), None)
    raise UserError(f"the run did not start: {first or 'no step was ever finished; see its log'}")


def _point_latest_at(folder: Path) -> None:
    # Replaced in one step: another run may be doing the same.
    link, fresh = folder.parent / LATEST, folder.parent / f".{LATEST}-{os.getpid()}"
    try:
        fresh.symlink_to(folder.name)
        fresh.replace(link)
    except OSError:
        fresh.unlink(missing_ok=True)


def _conclude(loaded: Loaded, path: Path, *, default: bool, report: bool) -> None:
    """Analyse the log; a run that has the default place also gets its folder filled."""
    folder = path.parent
    page, failed = beside(path, REPORT), list[UserError]()
    if default:
        try:
            (folder / "scenario.toml").write_text(to_toml(loaded.scenario), encoding="utf-8")
        except OSError as error:
            failed.append(UserError(f"cannot write {folder / 'scenario.toml'}: {error.strerror}; make room"))
        _point_latest_at(folder)
    with errors.status("analysing"):
        analysis = analyze([read_trace(path)])[0]
    console.print(metrics_table(analysis.metrics))
    say(f"log     {path}")
    if default or report:
        remedy = f"make room, or name another folder: zenoh-cbef analyze {path} --report --output DIR"
        with errors.status("drawing"):
            failed += write_outputs(analysis, folder, page.name.removesuffix(REPORT), report=report, remedy=remedy)
    if path.suffix == ACTIVE:
        tell(f"note: the log was not closed; 'zenoh-cbef recover {path} -o LOG' makes a whole one of what was written")
    if report and page.exists():
        say(f"report  {page}")
    tell_what_lacks(notes(analysis.metrics))
    for one in failed:
        tell(f"note: {one}" + (f", then: zenoh-cbef analyze {path} --report" * isinstance(one, MissingExtra)))


VERB = verb(_run, "run tracking --set consensus.rounds=5 --set steps=100")
