"""export: a log as plain arrays."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.options import LogFile
from zenoh_cbef.log.export import export
from zenoh_cbef.log.read_trace import read_trace


class Format(StrEnum):
    """What a log can be exported to."""

    npz = "npz"
    csv = "csv"


def _export(
    log: LogFile = Path("logs/latest"),
    to: Annotated[Format, typer.Option("--to", help="npz: one file of arrays. csv: a folder of tables.")] = Format.npz,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="The file, or for csv the folder.")] = None,
) -> None:
    """Write a log's truth, measurements and estimates as arrays that any program reads."""
    place = output or Path("run.npz" if to is Format.npz else "run-csv")
    for path in export(read_trace(log), place, to.value):
        typer.echo(path)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("export")(_export)
