"""dataset: check, show."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import group
from zenoh_cbef.cli.options.places import new_file
from zenoh_cbef.cli.options.shared import AsJson
from zenoh_cbef.cli.terminal.console import console
from zenoh_cbef.cli.terminal.recordings import summary_table, tell_findings
from zenoh_cbef.datasets.findings import findings, summary
from zenoh_cbef.datasets.folder import read_files
from zenoh_cbef.datasets.picture import draw
from zenoh_cbef.datasets.recorded import PREFIX, dataset_folder

_Folder = Annotated[
    Path,
    typer.Argument(
        metavar="FOLDER", help=f"A dataset's folder, or {PREFIX}NAME of the package.", parser=dataset_folder
    ),
]


def _check(folder: _Folder, as_json: AsJson = False) -> None:
    """Check a dataset: units, clock, truth, silent and swapped anchors. Exit status: 0 none is odd, 1 one is."""
    dataset = read_files(folder)
    if as_json:
        found = findings(dataset)
        print(json.dumps({"sound": not found, "findings": found}))
    else:
        found = tell_findings(dataset)
        typer.echo(f"{folder}: " + ("see above" if found else "nothing is odd"))
    raise typer.Exit(bool(found))


def _show(
    folder: _Folder,
    as_json: AsJson = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Draw anchors, rough fixes and truth as .png or .svg.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", "-f", help="Write over a picture that exists.")] = False,
) -> None:
    """Say what a dataset holds, and draw it."""
    if output is not None:
        new_file(output, {".png": "for a picture", ".svg": "for a drawing"}, force=force)
    dataset = read_files(folder)
    print(json.dumps(summary(dataset))) if as_json else console.print(summary_table(str(folder), dataset))
    if output is not None:
        typer.echo(draw(dataset, output))


VERB = group(
    "Check and show recorded data.", {"dataset check my-set": _check, "dataset show my-set -o my-set.png": _show}
)
