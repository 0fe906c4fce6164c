"""import: recordings in other formats become datasets."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.places import DATASET, new_folder_of
from zenoh_cbef.cli.options.shared import Force
from zenoh_cbef.cli.terminal.console import console, tell, warn
from zenoh_cbef.cli.terminal.recordings import summary_table, tell_findings
from zenoh_cbef.datasets import write_dataset
from zenoh_cbef.datasets.first_scenario import write_scenario
from zenoh_cbef.datasets.importing.bags import Bags, bag_in, bag_of, bags_in
from zenoh_cbef.datasets.importing.columns import map_of
from zenoh_cbef.datasets.importing.csv_files import Reading, files_of
from zenoh_cbef.datasets.importing.raw import Raw, dataset_of
from zenoh_cbef.datasets.importing.units import units_of
from zenoh_cbef.datasets.picture import draw
from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import MissingExtra
from zenoh_cbef.log.common.naming import RUN
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load

_BAG = "Of ROS bags"
_CSV = "Of CSV files"


def _import(
    source: Annotated[Path, typer.Argument(help="A CSV file of ranges, a folder of CSV files, or a ROS bag.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="The folder to write.")],
    anchors: Annotated[Path | None, typer.Option("--anchors", metavar="FILE", help="CSV file of the anchors.")] = None,
    truth: Annotated[
        str | None, typer.Option("--truth", help="CSV file of the target's true positions, or a bag's topic of them.")
    ] = None,
    mapped: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="MEANING=COLUMN", help="What a column or field is, as range=dist; repeatable."),
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option("--unit", metavar="[COLUMN=]UNIT", help="m, cm, mm, km, ft, in, s, ms, us or ns; repeatable."),
    ] = None,
    height: Annotated[
        float | None, typer.Option(min=-1e7, max=1e7, help="The known height, m, of a target in a plane.")
    ] = None,
    separator: Annotated[
        str | None, typer.Option(rich_help_panel=_CSV, help="What parts columns; else guessed.")
    ] = None,
    only: Annotated[
        str | None,
        typer.Option(metavar="COLUMN=VALUE", rich_help_panel=_CSV, help="Only these rows of ranges, as tag=7."),
    ] = None,
    topic: Annotated[
        list[str] | None, typer.Option("--topic", rich_help_panel=_BAG, help="Only ranges of this topic; repeatable.")
    ] = None,
    types: Annotated[
        list[Path] | None,
        typer.Option(
            "--types", metavar="MSG", rich_help_panel=_BAG, help="A .msg file that the bag lacks; repeatable."
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Make a dataset of a recording in another format, check it, and draw its anchors and first fix."""
    units = units_of(unit or [])
    new_folder_of(output, DATASET, force=force)
    if not source.exists():
        raise UserError(f"there is no {source}; name a CSV file, a folder, or a ROS bag")
    _refuse_own_log(source)
    reading = Reading(map_of(mapped or ()), units, separator, only)
    if bag_in(source):
        raw = _from_bag(source, anchors, truth, reading, Bags(reading.mapped, units, topic or (), types=types or ()))
    else:
        raw = _from_csv(source, anchors, truth, reading)
    _finish(raw, source, output, height)


def _refuse_own_log(source: Path) -> None:
    if source.suffix != ".mcap" and not (source / "run.mcap").exists():
        return
    own = False
    with suppress(UserError):  # what is no MCAP file at all is told by its reader
        own = RUN in open_log(source).metadata
    if own:
        raise UserError(
            f"{source} is a log of zenoh-cbef; make a dataset of it: zenoh-cbef export {source} --to dataset"
        )


def _from_bag(source: Path, anchors: Path | None, truth: str | None, reading: Reading, bags: Bags) -> Raw:
    """What a bag holds, and what files beside it do of anchors and truth."""
    way = Path(truth) if truth is not None and Path(truth).is_file() else None
    raw = replace(bags, truth=truth if way is None else None).read(bag_of(source))
    if way is not None:
        reading.read_truth(way, raw)
    if anchors is not None:
        reading.read_anchors(anchors, raw)
    return raw


def _from_csv(source: Path, anchors: Path | None, truth: str | None, reading: Reading) -> Raw:
    found = files_of(source) if source.is_dir() else {"ranges": source}
    if "ranges" not in found:
        bag = f", as {bags[0]}" if (bags := bags_in(source)) else ""
        raise UserError(f"{source} has no CSV file with range in its name; name the file of ranges itself{bag}")
    known = Path(truth) if truth is not None else found.get("truth")
    return reading.read(found["ranges"], anchors or found.get("anchors"), known)


def _finish(raw: Raw, source: Path, output: Path, height: float | None) -> None:
    dataset = dataset_of(raw, str(source))
    paths = [*write_dataset(dataset, output), write_scenario(dataset, output / "scenario.toml", height)]
    console.print(summary_table(str(output), dataset))
    try:
        paths.append(draw(dataset, output / "first-fix.png"))
    except MissingExtra as error:
        tell(f"left out: {error}")
    for path in paths:
        typer.echo(path)
    for note in raw.notes:
        tell(f"note: {note}")
    if tell_findings(dataset) or _refused(output / "scenario.toml"):
        tell(f"next: import again with what is said above, and --force, or look at {output}/first-fix.png")
    else:
        tell(f"next: zenoh-cbef run {output}/scenario.toml")


def _refused(path: Path) -> bool:
    """Whether 'run' would refuse a scenario; says why."""
    try:
        check(load(str(path)).plan)
    except UserError as error:
        warn([f"'run' refuses {path}: {error}"])
        return True
    return False


VERB = verb(_import, "import log.csv --anchors anchors.csv -o my-set --map range=dist --unit range=mm")
