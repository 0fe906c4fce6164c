"""analyze: what a logged run achieved."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.analysis.metrics import analyze, notes
from zenoh_cbef.analysis.outputs import FIGURES, METRICS, REPORT, write_outputs
from zenoh_cbef.analysis.report import errors_table
from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.completing import logs
from zenoh_cbef.cli.options.places import beside, new_folder_of
from zenoh_cbef.cli.options.shared import AsJson, Force, Skip, Smooth
from zenoh_cbef.cli.options.smoothing import smoothed
from zenoh_cbef.cli.options.typesetting import AsTable
from zenoh_cbef.cli.terminal.console import console, errors, say, tell, tell_what_lacks
from zenoh_cbef.cli.terminal.results import metrics_table
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.parts import find_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.numbers import SKIPPED


def _analyze(
    logs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="LOG", autocompletion=logs, help="A log, the folder of a run, or the files of one run."),
    ] = None,
    as_json: AsJson = False,
    skip: Skip = SKIPPED,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Folder for metrics.json; default: the log's.")
    ] = None,
    report: Annotated[bool, typer.Option("--report/--no-report", help="Also write report.html and figures.")] = False,
    smooth: Smooth = False,
    as_table: AsTable = None,
    force: Force = False,
) -> None:
    """Print how well a logged run tracked, beside the centralised filter and the bound; write its metrics."""
    paths = logs or [Path("logs/latest")]
    log = find_log(paths[0])
    own = output is None or output.resolve() == log.parent.resolve()
    if output is not None and not own:
        new_folder_of(output, [METRICS, *([REPORT, FIGURES] if report else [])], force=force)
    with errors.status("reading and analysing"):
        trace = read_trace(*paths)
        analysis = analyze([smoothed(trace, *paths) if smooth else trace], skip)[0]
    failed: list[UserError] = []
    default = beside(log, METRICS)
    prefix = default.name.removesuffix(METRICS) if own else ""
    # What was found is told before anything is written that may fail.
    if as_json:
        print(json.dumps(analysis.metrics.as_json()))
    elif as_table:
        print(as_table.text(errors_table(analysis)), end="")
    else:
        console.print(metrics_table(analysis.metrics))
    if not (as_json or as_table) or output or report:
        folder = output or default.parent
        failed = write_outputs(analysis, folder, prefix, report=report, remedy="name another folder with --output")
        page = folder / f"{prefix}{REPORT}"
        written = page.exists() and not any(str(page) in str(one) for one in failed)
        if report and written and not (as_json or as_table):
            say(f"report  {page}")
    tell_what_lacks(notes(analysis.metrics))
    # An output that the user asked for and that cannot be written is a mistake; of the others a note is enough.
    if failed and (output or report):
        raise UserError("; ".join(map(str, failed)))
    for one in failed:
        tell(f"note: {one}")


VERB = verb(_analyze, "analyze logs/latest --report")
