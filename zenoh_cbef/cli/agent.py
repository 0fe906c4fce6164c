"""agent: one agent process."""

from __future__ import annotations

import json
import sys
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.joining import JoiningCommand, JoiningContext, Patience, identity_of
from zenoh_cbef.cli.options.shared import Run
from zenoh_cbef.nodes.agent.process import run_agent
from zenoh_cbef.protocol.tls import common_name
from zenoh_cbef.quantities import MOST_AGENTS

_WORDS = {"joined": "is in run {run}, and waits for the others", "began": "is under way"}


def _agent(
    agent: Annotated[
        int, typer.Argument(metavar="ID", min=0, max=MOST_AGENTS - 1, help="Which agent of the scenario to be.")
    ],
    run: Run,
    ctx: JoiningContext,
    patience: Patience = 3.0,
    status_json: Annotated[bool, typer.Option("--status-json", hidden=True)] = False,
) -> None:
    """Run one agent process; it fetches the scenario from the run's target."""

    def report(stage: str, step: int = 0) -> None:
        if status_json:
            typer.echo(json.dumps({"agent": agent, "stage": stage, "step": step}))
        elif sys.stderr.isatty() and stage in _WORDS:
            sys.stderr.write(f"agent {agent} {_WORDS[stage].format(run=run)}\n")

    connection = ctx.joining.connection(common_name("agent", str(agent)))
    last = run_agent(identity_of("agent", str(agent), run, connection, patience), report)
    report("ended", last)
    if not status_json:
        typer.echo(f"agent {agent} ended " + (f"after step {last}" if last else f"before run {run} had begun"))


VERB = verb(_agent, "agent 3 --run mine --connect tcp/192.0.2.1:7447", JoiningCommand)
