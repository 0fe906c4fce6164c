"""sim: the same tracker without processes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress

from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.summary import summarize
from zenoh_cbef.cli.console import console, errors
from zenoh_cbef.cli.options import AsJson, Overrides, ScenarioName, Skip
from zenoh_cbef.cli.tables import metrics_table, scheme_line, summary_table
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.export import export
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate


def _sim(
    scenario: ScenarioName = "tracking",
    overrides: Overrides = None,
    seeds: Annotated[int, typer.Option(min=1, help="Simulate this many seeds, from the scenario's on, at once.")] = 1,
    as_json: AsJson = False,
    skip: Skip = 0.25,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the arrays of the run as .npz.")] = None,
) -> None:
    """Simulate a scenario without processes: in lockstep the same bits as `run`."""
    loaded = load(scenario, overrides or ()).scenario
    for warning in check(loaded):
        errors.print(f"warning: {warning}", highlight=False, soft_wrap=True)
    if line := scheme_line(loaded):
        errors.print(line, highlight=False, soft_wrap=True)
    if output is not None and seeds > 1:
        raise UserError("--output writes the arrays of one run; leave out --seeds")
    scenarios = [loaded.model_copy(update={"seed": loaded.seed + more}) for more in range(seeds)]
    with Progress(console=errors, transient=True, disable=not errors.is_terminal) as progress:
        task = progress.add_task("simulating", total=loaded.length)
        traces = simulate(scenarios, progress=lambda step: progress.update(task, completed=step))
    analyses = analyze(traces, skip)
    if output is not None:
        export(traces[0], output, "npz")
    if seeds > 1:
        summary = summarize([one.metrics for one in analyses])
        print(json.dumps(summary)) if as_json else console.print(summary_table(summary))
        return
    print(json.dumps(analyses[0].metrics)) if as_json else console.print(metrics_table(analyses[0].metrics))


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("sim")(_sim)
