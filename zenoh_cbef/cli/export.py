"""export: a log for other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.analysis.coverage import lacks
from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.places import DATASET, new_folder_of, new_place, stem_of
from zenoh_cbef.cli.options.shared import Force, LogFile, Smooth
from zenoh_cbef.cli.options.smoothing import smoothed
from zenoh_cbef.cli.terminal.console import errors, tell_what_lacks
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.parts import find_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.trace import Trace
from zenoh_cbef.viewers.arrays import export
from zenoh_cbef.viewers.recording import write_recording
from zenoh_cbef.viewers.rerun_file import write_rrd
from zenoh_cbef.viewers.ros2 import write_ros2
from zenoh_cbef.viewers.scene import read_scene
from zenoh_cbef.viewers.tum import write_tum
from zenoh_cbef.viewers.viz import write_viz


class Format(StrEnum):
    """What a log can be exported to."""

    npz = "npz"
    csv = "csv"
    parquet = "parquet"
    viz = "viz"
    rrd = "rrd"
    dataset = "dataset"
    ros2 = "ros2"
    tum = "tum"

    @property
    def ending(self) -> str:
        """The end of the output's name, after the log's, where no -o names it."""
        return {Format.npz: ".npz", Format.viz: "-viz.mcap", Format.rrd: ".rrd"}.get(self, f"-{self.value}")

    @property
    def suffix(self) -> str:
        """The suffix of -o that means this format."""
        return ".mcap" if self is Format.viz else f".{self.value}"


_HELP = (
    "npz: one file of arrays. csv, parquet: a folder of tables. viz: for Foxglove and Lichtblick. rrd: for Rerun. "
    "dataset: a folder of ranges to run again. ros2: a bag of ROS 2. tum: a folder of trajectories for evo."
)
_SCENES = {Format.viz: write_viz, Format.rrd: write_rrd, Format.ros2: write_ros2, Format.tum: write_tum}
"""What writes the formats that show a scene."""


def _export(
    log: LogFile = Path("logs/latest"),
    to: Annotated[Format | None, typer.Option("--to", help=_HELP)] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The file or folder to write; default: beside the log.")
    ] = None,
    smooth: Smooth = False,
    force: Force = False,
) -> None:
    """Write a log's truth, measurements and estimates as arrays that any program reads, or for viewers and ROS 2."""
    found = find_log(log)
    to = _format(to, output)
    if output is not None and output.exists() and output.samefile(found):
        raise UserError(f"{output} is the log itself, and logs are never overwritten; choose another --output")
    place = found.with_name(stem_of(found) + to.ending) if output is None else _place(output, to, force=force)
    with errors.status("reading and writing"):
        trace, paths = _written(log, to, place, smooth=smooth)
    tell_what_lacks(lacks(trace))
    for path in paths:
        typer.echo(path)


def _written(log: Path, to: Format, place: Path, *, smooth: bool) -> tuple[Trace, list[Path]]:
    if to in _SCENES:
        scene = read_scene(log, (lambda trace: smoothed(trace, log)) if smooth else None)
        return scene.trace, _SCENES[to](scene, place)
    trace = read_trace(log)
    trace = smoothed(trace, log) if smooth else trace
    return trace, write_recording(trace, place) if to is Format.dataset else export(trace, place, to.value)


def _place(output: Path, to: Format, *, force: bool) -> Path:
    if to is Format.dataset:
        return new_folder_of(output, DATASET, force=force)
    return new_place(output, to.value, force=force)


def _format(to: Format | None, output: Path | None) -> Format:
    """The format that is meant by --to, or else by the suffix of -o. Raises UserError where they contradict."""
    meant = next((one for one in Format if output is not None and output.suffix == one.suffix), None)
    if to is not None and meant not in {None, to}:
        raise UserError(f"--output {output} is a name for {meant}, but --to says {to}; leave --to out, or rename it")
    if to is None and meant is None and output is not None:
        known = ", ".join(one.suffix for one in Format)
        raise UserError(f"--output {output} must end with one of {known}, or say the format with --to")
    return to or meant or Format.npz


VERB = verb(_export, "export logs/latest --to csv")
