"""sim: the same tracker without processes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.analysis.below import bound_note
from zenoh_cbef.analysis.metrics import notes
from zenoh_cbef.analysis.summary import summarize
from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.places import new_file
from zenoh_cbef.cli.options.shared import AsJson, Force, Jobs, Overrides, ScenarioName, Skip
from zenoh_cbef.cli.terminal.beforehand import tell_beforehand
from zenoh_cbef.cli.terminal.console import console, tell, tell_what_lacks
from zenoh_cbef.cli.terminal.progress import bar
from zenoh_cbef.cli.terminal.results import metrics_table, summary_table
from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment.seeds import analyses_of, metrics_of
from zenoh_cbef.numbers import SKIPPED
from zenoh_cbef.scenario.load import load
from zenoh_cbef.viewers.arrays import export


def _sim(
    scenario: ScenarioName = "tracking",
    overrides: Overrides = None,
    seeds: Annotated[
        int, typer.Option(min=1, max=1_000_000, help="Simulate this many seeds, from the scenario's on.")
    ] = 1,
    jobs: Jobs = 0,
    as_json: AsJson = False,
    skip: Skip = SKIPPED,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the arrays of the run as .npz.")] = None,
    force: Force = False,
) -> None:
    """Simulate a scenario without processes: in lockstep the same bits as `run`."""
    if output is not None:
        new_file(output, {".npz": "for arrays"}, force=force)
        if seeds > 1:
            raise UserError("--output writes the arrays of one run; leave out --seeds")
    plan = load(scenario, overrides or ()).plan
    tell_beforehand(plan)
    if seeds > 1:
        with bar("simulating", seeds) as done:
            summary = summarize(metrics_of(plan.scenario, seeds, skip, jobs, progress=done, tell=tell))
        print(json.dumps(summary.as_json())) if as_json else console.print(summary_table(summary))
        spread = summary.spreads["ratio_to_bound"]
        tell_what_lacks(filter(None, [bound_note(spread.median if spread else None, seeds * plan.scenario.length)]))
        return
    with bar("simulating", plan.scenario.length) as done:
        analysis = analyses_of([plan.scenario], skip, done)[0]
    metrics = analysis.metrics
    print(json.dumps(metrics.as_json())) if as_json else console.print(metrics_table(metrics))
    tell_what_lacks(notes(metrics))
    if output is not None:
        export(analysis.trace, output, "npz")


VERB = verb(_sim, "sim paper --seeds 20")
