"""compare: logged runs side by side."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from zenoh_cbef.analysis.compare import SMOOTHED, Row, differences, filled, names_of, row, table_of, write_comparison
from zenoh_cbef.analysis.metrics import analyze, notes
from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.completing import logs
from zenoh_cbef.cli.options.places import new_file
from zenoh_cbef.cli.options.shared import AsJson, Force, Skip, Smooth
from zenoh_cbef.cli.options.smoothing import smoothed
from zenoh_cbef.cli.options.typesetting import AsTable
from zenoh_cbef.cli.terminal.console import console, errors, tell, tell_what_lacks, warn
from zenoh_cbef.cli.terminal.fitting import Fitting
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import LOGS
from zenoh_cbef.log.read.parts import find_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.log.tools.collection import expanded
from zenoh_cbef.numbers import SKIPPED, number
from zenoh_cbef.trace import Trace
from zenoh_cbef.writing import write_whole

Logs = Annotated[
    list[Path],
    typer.Argument(metavar="LOG", autocompletion=logs, help="Logs, folders of runs, names in logs/, or @TAG."),
]
AsCsv = Annotated[bool, typer.Option("--csv", help="Print comma-separated values instead of a table.")]
Outputs = Annotated[
    list[Path] | None,
    typer.Option("--output", "-o", help="Write the rows (.csv) or the curves (.html); repeatable."),
]

_HEADS = {
    "position_rmse": "pos",
    "velocity_rmse": "vel",
    SMOOTHED: "smooth",
    "ratio_to_centralized": "ratio",
    "nees.average": "NEES",
    "claimed_position_error": "claimed",
    "disagreement": "apart",
    "bytes_per_step": "B/step",
}
_SCHEMES = {"average": "", "chebyshev": " Cheb.", "running-sums": " sums"}


def _compare(
    logs: Logs,
    as_json: AsJson = False,
    as_csv: AsCsv = False,
    output: Outputs = None,
    force: Force = False,
    skip: Skip = SKIPPED,
    smooth: Smooth = False,
    as_table: AsTable = None,
) -> None:
    """Put logged runs side by side: errors, consistency, disagreement, bytes and losses, a row for each."""
    for path in output or ():
        new_file(path, {".csv": "for the rows", ".html": "for the curves"}, force=force)
    with errors.status("reading and analysing"):
        paths, traces = _read(expanded(logs))
        if smooth:
            traces = [smoothed(trace, path) for trace, path in zip(traces, paths, strict=True)]
        names = names_of(traces, paths)
        analyses = [analyze([trace], skip)[0] for trace in traces]
    rows = [row(one, name) for one, name in zip(analyses, names, strict=True)]
    for one, name in zip(analyses, names, strict=True):
        tell_what_lacks(notes(one.metrics), name)
    warn(differences(traces, names))
    if as_json:
        print(json.dumps([one.as_json() for one in rows]))
    elif as_csv:
        print(_csv(rows), end="")
    elif as_table:
        print(as_table.text(table_of(rows)), end="")
    else:
        console.print(runs_table(rows))
    for path in output or ():
        if path.suffix == ".html":
            write_comparison(analyses, names, path)
        else:
            write_whole(path, _csv(rows))


def _read(logs: Sequence[Path]) -> tuple[list[Path], list[Trace]]:
    """Read the logs. A file that is no log is named and left out, as `logs/*` may have some.

    Raises UserError where a name leads nowhere, and where none is left.
    """
    found: dict[Path, tuple[Path, Trace]] = {}
    refused: list[UserError] = []
    # logs/latest stands for the run that it leads to, which logs/* names, too.
    for given in sorted(logs, key=Path.is_symlink):
        try:
            path = find_log(given)
            if not given.is_symlink() or path.resolve() not in {one.resolve() for one, _ in found.values()}:
                found[given] = path, read_trace(path)
        except UserError as error:
            if not (given.exists() or (LOGS / given).exists()):
                raise
            refused.append(error)
    if not found:
        raise refused[0] if len(logs) == 1 else UserError("none of these is a log of a run; give runs' folders or logs")
    for one in refused:
        tell(f"left out: {one}")
    kept = [found[given] for given in dict.fromkeys(logs) if given in found]
    return [path for path, _ in kept], [trace for _, trace in kept]


def _csv(rows: list[Row]) -> str:
    text = io.StringIO()
    told = [one.as_json() for one in rows]
    writer = csv.DictWriter(text, told[0].keys(), lineterminator="\n")
    writer.writeheader()
    writer.writerows(told)
    return text.getvalue()


def runs_table(rows: list[Row]) -> Fitting:
    """A row for each run."""
    # Narrow enough for eighty columns where names are short; everything else is in --json and --csv.
    heads = filled(rows, _HEADS)
    errors = "pos, vel: RMSE in m and m/s; ratio: pos to centralised; " if "position_rmse" in heads else ""
    claimed = "claimed: the error as covariances say, in m; " if "claimed_position_error" in heads else ""
    caption = f"{errors}{claimed}apart: disagreement in m; missed: lost or late"
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False, caption=caption, caption_justify="left")
    table.add_column("run", overflow="fold")
    for head in ("filter", "L"):
        table.add_column(head, no_wrap=True)
    for head in (*heads.values(), "missed"):
        table.add_column(head, justify="right", no_wrap=True)
    for one in rows:
        name = one.run if one.complete else f"{one.run} (incomplete)"
        found = one.metrics
        missed = "-" if found["missed"] is None else f"{found['missed']:.1%}"
        averaging = f"{one.rounds}{_SCHEMES[one.consensus]}"
        table.add_row(name, one.filter, averaging, *(_short(found[each]) for each in heads), missed)
    return Fitting(table)


def _short(value: float | None) -> str:
    return number(value) if value is None or value >= 1000.0 else f"{value:.3g}"


VERB = verb(_compare, "compare logs/one logs/two -o curves.html")
