"""scenario: list, show, check, new."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import group
from zenoh_cbef.cli.options.completing import scenarios
from zenoh_cbef.cli.options.shared import Overrides, ScenarioName
from zenoh_cbef.cli.terminal.listing import list_named
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load, purposes, read_source, to_toml
from zenoh_cbef.scenario.size import refuse_a_trace_beyond_memory
from zenoh_cbef.words import counted
from zenoh_cbef.writing import refuse_in_file, write_whole


def _list() -> None:
    """List the built-in scenarios."""
    list_named(purposes())


def _show(
    scenario: ScenarioName = "tracking",
    overrides: Overrides = None,
    full: Annotated[bool, typer.Option("--full", help="With every default written out.")] = False,
) -> None:
    """Print a scenario as it is written; with --full or --set, as it is run."""
    if full or overrides:
        typer.echo(to_toml(load(scenario, overrides or ()).scenario), nl=False)
    else:
        typer.echo(read_source(scenario)[0], nl=False)


def _check(scenario: ScenarioName = "tracking", overrides: Overrides = None) -> None:
    """Check a scenario: exit status 0 it can run, 2 it cannot, and why."""
    plan = load(scenario, overrides or ()).plan
    for warning in check(plan):
        typer.echo(f"warning: {warning}")
    refuse_a_trace_beyond_memory(plan)
    loaded, edges = plan.scenario, plan.edges.tolist()
    typer.echo(
        f"{loaded.name}: {counted(loaded.count, 'agent')}, {counted(len(edges), 'edge')}, "
        f"{counted(loaded.length, 'step')} of "
        f"{loaded.dt} s, {loaded.filter.kind}: it can run"
    )
    typer.echo("edges: " + " ".join(f"{first}-{second}" for first, second in edges))


def _new(
    file: Annotated[Path, typer.Argument(help="The file to write.")],
    base: Annotated[
        str, typer.Option("--from", autocompletion=scenarios, help="The scenario to start from.")
    ] = "tracking",
    force: Annotated[bool, typer.Option("--force", "-f", help="Write over a file that exists.")] = False,
) -> None:
    """Write a new scenario file to edit."""
    if file.exists() and not force:
        raise UserError(f"{file} exists; choose another name, or write over it with --force")
    refuse_in_file(file, "choose another place")
    write_whole(file, read_source(base)[0])
    typer.echo(f"{file} written; edit it, then: zenoh-cbef run {file}")


VERB = group(
    "List, show, check and make scenarios.",
    {
        "scenario list": _list,
        "scenario show paper --full": _show,
        "scenario check mine.toml --set agents.count=12": _check,
        "scenario new mine.toml --from paper": _new,
    },
)
