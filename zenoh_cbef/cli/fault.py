"""fault: faults in a run that goes on."""

from __future__ import annotations

import json
from typing import Annotated

import typer
from rich.table import Table

from zenoh_cbef.cli.calling.offer import group
from zenoh_cbef.cli.options.asking import RunName, locate
from zenoh_cbef.cli.options.completing import faults as kinds_begun
from zenoh_cbef.cli.options.joining import JoiningCommand, JoiningContext
from zenoh_cbef.cli.options.shared import LONGEST_SECONDS, AsJson
from zenoh_cbef.cli.terminal.console import console, warn
from zenoh_cbef.cli.terminal.fitting import Fitting
from zenoh_cbef.errors import UserError
from zenoh_cbef.outside.operator import Operator
from zenoh_cbef.scenario.load import value_of
from zenoh_cbef.testing.faults import refuse_broken
from zenoh_cbef.words import meant


def _add(
    kind: Annotated[
        str,
        typer.Argument(metavar="KIND", autocompletion=kinds_begun, help="As in a scenario: loss, delay, crash, ..."),
    ],
    ctx: JoiningContext,
    keys: Annotated[list[str] | None, typer.Argument(metavar="KEY=VALUE", help="Its keys, as links=agent:3")] = None,
    run: RunName = None,
    seconds: Annotated[
        float | None, typer.Option("--for", min=0.001, max=LONGEST_SECONDS, help="How long it lasts, in seconds.")
    ] = None,
) -> None:
    """Inject a fault, from now on or from the run time `from=`."""
    known = dict(kinds_begun(""))
    if kind not in known and ":" not in kind:  # The target knows whether it has package.module:Class.
        near = meant(kind, known, "see 'zenoh-cbef fault kinds'")
        raise UserError(f"the kind must be one of {', '.join(known)}, not {kind!r}; {near}")
    table: dict[str, object] = {"kind": kind}
    for one in keys or ():
        key, separator, text = one.partition("=")
        if not separator:
            raise UserError(f"{one!r} is not of the form key=value, as in probability=0.3")
        table[key.strip()] = value_of(text)
    refuse_broken(kind, table)
    name, connection = locate(run, ctx.joining, order="inject the fault into it")
    with Operator(name, connection) as operator:
        added = operator.inject(table, seconds)
    typer.echo(f"fault {added['number']} ({kind}) of run {name} begins at {added['from']:.2f} s")
    warn(added.get("warnings", ()))


def _list(
    ctx: JoiningContext,
    run: RunName = None,
    as_json: AsJson = False,
) -> None:
    """List the faults that were injected, and whether they are on."""
    name, connection = locate(run, ctx.joining)
    with Operator(name, connection) as operator:
        faults = operator.injected()
    if as_json:
        typer.echo(json.dumps([fault.table for fault in faults], indent=2))
        return
    if not faults:
        typer.echo(f"nothing was injected into run {name}")
        return
    heads = ("", "kind", "from", "until", "", "keys")
    table = Table(*heads, title=f"faults injected into run {name}", title_justify="left")
    for fault in faults:
        until = "" if fault.until is None else f"{fault.until:.2f} s"
        shown = ", ".join(f"{key}={json.dumps(value)}" for key, value in fault.keys.items())
        on = "on" if fault.active else ""
        table.add_row(str(fault.number), fault.kind, f"{fault.since:.2f} s", until, on, shown)
    console.print(Fitting(table))


def _clear(
    ctx: JoiningContext,
    numbers: Annotated[
        list[int] | None, typer.Argument(metavar="NUMBER", min=0, max=1_000_000, help="Default: all.")
    ] = None,
    run: RunName = None,
) -> None:
    """End injected faults."""
    name, connection = locate(run, ctx.joining, order="end its injected faults")
    with Operator(name, connection) as operator:
        ended = operator.clear(numbers or ())
    typer.echo(f"run {name}: ended {', '.join(f'fault {one}' for one in ended) or 'nothing'}")


def _kinds() -> None:
    """List the kinds of faults, and what they do. docs/scenario.md has their keys."""
    table = Table("kind", "what it does")
    for kind, words in kinds_begun(""):
        table.add_row(kind, words)
    console.print(Fitting(table))


VERB = group(
    "Inject faults into a run that goes on.",
    {
        "fault add loss probability=0.3 links=agent:3 --for 5": _add,
        "fault list --json": _list,
        "fault clear 1": _clear,
    },
    JoiningCommand,
)
VERB.command("kinds", epilog="Example: zenoh-cbef fault kinds")(_kinds)  # It joins no run.
