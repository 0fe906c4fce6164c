"""runs: those in logs/, as a collection."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from typer.exceptions import Abort

from zenoh_cbef.cli.calling.offer import group
from zenoh_cbef.cli.options.completing import logs
from zenoh_cbef.cli.options.shared import AsJson
from zenoh_cbef.cli.terminal.console import console, errors, tell
from zenoh_cbef.cli.terminal.fitting import Fitting
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.tools.collection import Kept, find_run, remove, runs, tag
from zenoh_cbef.log.tools.judged import judged
from zenoh_cbef.numbers import number
from zenoh_cbef.words import first_of

Names = Annotated[list[str], typer.Argument(metavar="RUN...", autocompletion=logs, help="Names of runs in logs/.")]
_NOTHING_DONE = 1
_RESULTS = ("complete", "stopped", "incomplete", "lost", "unknown")
Sought = Annotated[str | None, typer.Option(help="Only runs of this one.")]


def _list(
    scenario: Sought = None,
    filter_: Annotated[str | None, typer.Option("--filter", help="Only runs with this filter.")] = None,
    fault: Annotated[str | None, typer.Option(help="Only runs with a fault of this kind.")] = None,
    result: Annotated[
        str | None, typer.Option(help="Only runs that are complete, stopped, incomplete, lost or unknown.")
    ] = None,
    tagged: Annotated[str | None, typer.Option("--tag", help="Only runs with this tag.")] = None,
    as_json: AsJson = False,
) -> None:
    """List the runs in logs/, or those that are looked for; a run that was not analysed yet is analysed now."""
    if result is not None and result not in _RESULTS:
        raise UserError(f"no run has the result {result!r}; give one of {', '.join(_RESULTS)}")
    every = runs()
    if not every:
        tell("note: there is no run in logs/ of this folder")
    sought = {"scenario": scenario, "filter": filter_, "fault": fault, "tag": tagged}
    for what, name in sought.items():
        there = sorted({each for one in every for each in _of(one)[what]})
        if name is not None and name not in there and every:
            known = first_of(there, 10) if there else "none"
            tell(f"note: no run in logs/ has the {what} {name!r}; they have {known}")
    chosen = [one for one in every if all(name is None or name in _of(one)[what] for what, name in sought.items())]
    found = [one for one in _judged(chosen) if result in {None, one.result}]
    if as_json:
        print(json.dumps([_told(one) for one in found]))
        return
    table = Table()
    for head in ("run", "scenario", "filter", "faults", "result", "RMSE", "tags"):
        table.add_column(head, overflow="fold")
    for one in found:
        cells = one.scenario, one.filter, ", ".join(one.faults), one.result, number(one.rmse, "m")
        table.add_row(one.name, *cells, " ".join(f"@{each}" for each in one.tags))
    console.print(Fitting(table))


def _of(run: Kept) -> dict[str, list[str]]:
    """What runs are looked for by."""
    return {"scenario": [run.scenario], "filter": [run.filter], "fault": run.faults, "tag": run.tags}


def _show(names: Names) -> None:
    """Show what runs are, and what came of them, as JSON."""
    for one in _judged([find_run(name) for name in names]):
        print(json.dumps(_told(one), indent=1))


def _judged(found: Sequence[Kept]) -> list[Kept]:
    with errors.status("reading") as status:
        return judged(found, lambda name: status.update(f"analysing {name}"))


def _told(one: Kept) -> dict[str, object]:
    return asdict(one) | {"log": str(one.log)}


def _tag(
    names: Names,
    add: Annotated[list[str] | None, typer.Option("--add", "-a", metavar="TAG", help="Give it; repeatable.")] = None,
    take: Annotated[
        list[str] | None, typer.Option("--remove", "-r", metavar="TAG", help="Take it away; repeatable.")
    ] = None,
) -> None:
    """Give runs tags, and take them away; 'compare @TAG' then means all that have it."""
    if not add and not take:
        raise UserError("say which tag, with --add TAG or --remove TAG")
    for one in [find_run(name) for name in names]:
        typer.echo(f"{one.name}: {' '.join(f'@{each}' for each in tag(one, add or (), take or ())) or 'no tag'}")


def _rm(names: Names, yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False) -> None:
    """Delete runs: their folders in logs/, with log, report and figures."""
    found = list({one.name: one for one in map(find_run, names)}.values())
    if not yes:
        _ask(f"delete {', '.join(str(Path('logs') / one.name) for one in found)}?")
    for one in found:
        remove(one)
        typer.echo(f"{one.name} deleted")


def _ask(question: str) -> None:
    try:
        agreed = typer.confirm(question, err=True)
    except Abort:
        raise UserError("nothing was deleted, as no answer came; in a script give --yes") from None
    if not agreed:
        tell("nothing was deleted")
        raise typer.Exit(_NOTHING_DONE)


VERB = group(
    "List, show, tag and delete the runs in logs/.",
    {
        "runs list --filter sicf --fault loss": _list,
        "runs show latest": _show,
        "runs tag latest --add paper": _tag,
        "runs rm old-run": _rm,
    },
)
