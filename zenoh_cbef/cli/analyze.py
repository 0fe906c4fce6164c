"""analyze: what a logged run achieved."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.outputs import write_outputs
from zenoh_cbef.cli.console import console
from zenoh_cbef.cli.options import AsJson, Skip
from zenoh_cbef.cli.tables import metrics_table
from zenoh_cbef.log.parts import find_log
from zenoh_cbef.log.read_trace import read_trace


def _analyze(
    logs: Annotated[
        list[Path] | None, typer.Argument(metavar="LOG...", help="A log, the folder of a run, or the files of one run.")
    ] = None,
    as_json: AsJson = False,
    skip: Skip = 0.25,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for metrics.json; default: the log's.")
    ] = None,
    report: Annotated[bool, typer.Option("--report/--no-report", help="Also write report.html and figures.")] = False,
) -> None:
    """Print how well a logged run tracked, beside the centralised filter and the bound; write its metrics."""
    paths = logs or [Path("logs/latest")]
    analysis = analyze([read_trace(*paths)], skip)[0]
    folder = output or find_log(paths[0]).parent
    if not as_json or output or report:
        write_outputs(analysis, folder, report=report)
    if as_json:
        print(json.dumps(analysis.metrics))
        return
    console.print(metrics_table(analysis.metrics))


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("analyze")(_analyze)
