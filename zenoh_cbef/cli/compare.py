"""compare: logged runs side by side."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.table import Table

from zenoh_cbef.analysis.compare import differences, names_of, row, write_picture
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.cli.console import console, errors, number
from zenoh_cbef.cli.options import AsJson, Skip
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.parts import find_log
from zenoh_cbef.log.read_trace import read_trace

Logs = Annotated[list[Path], typer.Argument(metavar="LOG...", help="Logs, folders of runs, or names in logs/.")]
AsCsv = Annotated[bool, typer.Option("--csv", help="Print comma-separated values instead of a table.")]
Outputs = Annotated[
    list[Path] | None,
    typer.Option("--output", "-o", help="Write the rows (.csv) or the curves (.html); repeatable."),
]

_HEADS = {
    "position_rmse": "pos",
    "velocity_rmse": "vel",
    "ratio_to_centralized": "ratio",
    "nees.average": "NEES",
    "disagreement": "apart",
    "bytes_per_step": "B/step",
}
_SCHEMES = {"average": "", "chebyshev": " Cheb.", "running-sums": " sums"}


def _compare(
    logs: Logs,
    as_json: AsJson = False,
    as_csv: AsCsv = False,
    output: Outputs = None,
    skip: Skip = 0.25,
) -> None:
    """Put logged runs side by side: errors, honesty, agreement, bytes and loss, a row for each."""
    for path in output or ():
        if path.suffix not in {".csv", ".html"}:
            raise UserError(f"--output {path} must end with .csv for the rows or .html for the curves")
    paths = [find_log(log) for log in logs]
    traces = [read_trace(path) for path in paths]
    names = names_of(traces, paths)
    analyses = [analyze([trace], skip)[0] for trace in traces]
    rows = [row(one, name) for one, name in zip(analyses, names, strict=True)]
    for warning in differences(traces, names):
        errors.print(f"warning: {warning}", highlight=False, soft_wrap=True)
    for path in output or ():
        if path.suffix == ".html":
            write_picture(analyses, names, path)
        else:
            _write(path, _csv(rows))
    if as_json:
        print(json.dumps(rows))
    elif as_csv:
        print(_csv(rows), end="")
    else:
        console.print(_table(rows))


def _csv(rows: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0].keys(), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}; choose another --output") from None


def _table(rows: list[dict[str, Any]]) -> Table:
    # Narrow enough for eighty columns where names are short; everything else is in --json and --csv.
    caption = "pos, vel: RMSE in m and m/s; ratio: pos to centralised; apart: disagreement in m; missed: lost or late"
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False, caption=caption, caption_justify="left")
    table.add_column("run", overflow="fold")
    for head in ("filter", "L"):
        table.add_column(head, no_wrap=True)
    for head in (*_HEADS.values(), "missed"):
        table.add_column(head, justify="right", no_wrap=True)
    for one in rows:
        name = one["run"] if one["complete"] else f"{one['run']} (incomplete)"
        missed = "-" if one["missed"] is None else f"{one['missed']:.1%}"
        averaging = f"{one['rounds']}{_SCHEMES[one['consensus']]}"
        table.add_row(name, one["filter"], averaging, *(_short(one[each]) for each in _HEADS), missed)
    return table


def _short(value: float | None) -> str:
    return number(value) if value is None or value >= 1000.0 else f"{value:.3g}"


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("compare")(_compare)
