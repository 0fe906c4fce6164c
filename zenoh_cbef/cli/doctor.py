"""doctor: what is wrong with this host or its network, and what to do."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.asking import RunName, locate
from zenoh_cbef.cli.options.joining import Joining, JoiningCommand, JoiningContext
from zenoh_cbef.cli.options.shared import AsJson
from zenoh_cbef.cli.terminal.console import console
from zenoh_cbef.errors import UserError
from zenoh_cbef.outside.doctor import (
    OK,
    PROBLEM,
    WARNING,
    Finding,
    check_count,
    check_endpoints,
    check_host,
    check_size,
)
from zenoh_cbef.outside.doctor_run import check_run
from zenoh_cbef.outside.registry import known_runs
from zenoh_cbef.quantities import MOST_AGENTS

_AGENTS = 100
_COLOURS = {OK: "green", WARNING: "yellow", PROBLEM: "red"}


def _doctor(
    ctx: JoiningContext,
    run: RunName = None,
    agents: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=1_000_000,
            help=f"How many agents this host is to run; default: those of --run, else {_AGENTS}.",
        ),
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Where logs go.")] = Path("logs"),
    strict: Annotated[bool, typer.Option("--strict", help="Status 1 also for warnings.")] = False,
    as_json: AsJson = False,
) -> None:
    """Check this host, endpoints, and a run: status 0 if all is well, 2 if there is a problem."""
    worst, told = OK, []
    for finding in _findings(ctx.joining, run, agents, output):
        worst = max(worst, finding.level, key=[OK, WARNING, PROBLEM].index)
        told.append(asdict(finding))
        if not as_json:
            line = Text.assemble(
                (f"{finding.level:8}", _COLOURS[finding.level]), f" {finding.subject:10} {finding.text}"
            )
            console.print(line, soft_wrap=True)
    if as_json:
        typer.echo(json.dumps({"worst": worst, "findings": told}, indent=2))
    if worst == PROBLEM:
        raise typer.Exit(2)
    if worst == WARNING and strict:
        raise typer.Exit(1)


def _findings(joining: Joining, run: str | None, agents: int | None, output: Path) -> Iterator[Finding]:
    """One after the other, so that they are seen as they come."""
    try:
        connection = joining.connection("operator")
    except UserError as error:
        yield Finding("TLS", PROBLEM, str(error))
        return
    yield from check_host(output, tls=connection.tls)
    if run is None or agents is not None:
        yield check_count(agents or _AGENTS, MOST_AGENTS)
        yield from check_size(agents or _AGENTS)
    troubles = list(check_endpoints(connection.connect))
    yield from troubles
    if any(one.level == PROBLEM for one in troubles):
        return
    try:
        if connection.connect or connection.config:
            yield from check_run(run, joining.connection("operator"), sized=agents is None)
        elif run is not None:
            yield from check_run(*locate(run, joining), sized=agents is None)
        elif runs := known_runs():
            yield Finding("runs", OK, f"on this host: {', '.join(runs)}; --run looks at one")
    except UserError as error:
        yield Finding("run", PROBLEM, str(error))


VERB = verb(_doctor, "doctor --agents 24", JoiningCommand)
