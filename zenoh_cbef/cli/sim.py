"""sim: the same tracker without processes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from zenoh_cbef.analysis.divergence import refuse_divergence
from zenoh_cbef.analysis.metrics import analyze, notes
from zenoh_cbef.analysis.summary import summarize
from zenoh_cbef.cli.beforehand import tell_beforehand
from zenoh_cbef.cli.console import console, errors, tell_what_lacks
from zenoh_cbef.cli.offer import verb
from zenoh_cbef.cli.options import AsJson, Force, Overrides, ScenarioName, Skip
from zenoh_cbef.cli.places import new_file
from zenoh_cbef.cli.progress import bar
from zenoh_cbef.cli.tables import metrics_table, summary_table
from zenoh_cbef.errors import UserError
from zenoh_cbef.quantities import SEEDS
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.viewers.arrays import export


def _sim(
    scenario: ScenarioName = "tracking",
    overrides: Overrides = None,
    seeds: Annotated[
        int, typer.Option(min=1, max=1_000_000, help="Simulate this many seeds, from the scenario's on, at once.")
    ] = 1,
    as_json: AsJson = False,
    skip: Skip = 0.25,
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
    loaded = plan.scenario
    scenarios = [loaded.model_copy(update={"seed": (loaded.seed + more) % SEEDS}) for more in range(seeds)]
    with bar("simulating", loaded.length) as done, np.errstate(all="ignore"):  # What diverges is told in a sentence.
        traces = simulate(scenarios, progress=done)
    for trace in traces:
        refuse_divergence(trace)
    with errors.status("analysing"), np.errstate(over="raise", divide="raise", invalid="raise"):
        analyses = analyze(traces, skip)
    if output is not None:
        export(traces[0], output, "npz")
    if seeds > 1:
        summary = summarize([one.metrics for one in analyses])
        print(json.dumps(summary.as_json())) if as_json else console.print(summary_table(summary))
        return
    metrics = analyses[0].metrics
    print(json.dumps(metrics.as_json())) if as_json else console.print(metrics_table(metrics))
    tell_what_lacks(notes(metrics))


VERB = verb(_sim, "sim paper --seeds 20")
