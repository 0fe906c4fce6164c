"""export: a log for other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.options import LogFile
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.export import export
from zenoh_cbef.log.parts import find_log
from zenoh_cbef.log.read_trace import read_trace
from zenoh_cbef.log.viewers.rerun_file import write_rrd
from zenoh_cbef.log.viewers.scene import read_scene
from zenoh_cbef.log.viewers.viz import write_viz


class Format(StrEnum):
    """What a log can be exported to, and how the result is called unless it is told."""

    npz = "npz"
    csv = "csv"
    parquet = "parquet"
    viz = "viz"
    rrd = "rrd"

    @property
    def usual(self) -> Path:
        """The file or folder."""
        name = {"csv": "run-csv", "parquet": "run-parquet", "viz": "run-viz.mcap"}.get(self.value)
        return Path(name or f"run.{self.value}")


_HELP = "npz: one file of arrays. csv, parquet: a folder of tables. viz: for Foxglove and Lichtblick. rrd: for Rerun."


def _export(
    log: LogFile = Path("logs/latest"),
    to: Annotated[Format, typer.Option("--to", help=_HELP)] = Format.npz,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="The file or folder to write.")] = None,
) -> None:
    """Write a log's truth, measurements and estimates as arrays that any program reads, or as scenes for viewers."""
    place = output or to.usual
    if place.exists() and place.samefile(find_log(log)):
        raise UserError(f"{place} is the log itself, and logs are never overwritten; choose another --output")
    if to is Format.viz:
        paths = write_viz(read_scene(log), place)
    elif to is Format.rrd:
        paths = write_rrd(read_scene(log), place)
    else:
        paths = export(read_trace(log), place, to.value)
    for path in paths:
        typer.echo(path)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("export")(_export)
