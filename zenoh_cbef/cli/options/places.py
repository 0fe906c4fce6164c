"""Where runs and other outputs go, and when they are written over: the one rule of docs/outputs.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import ACTIVE
from zenoh_cbef.writing import refuse_in_file

_FILES = {".csv", ".html", ".json", ".mcap", ".npz", ".parquet", ".pdf", ".png", ".rrd", ".svg", ".toml"}
"""Suffixes of files; the name of a folder of results ends with none of them."""

_FOLDERS = {"csv": "tables", "parquet": "tables", "tum": "trajectories", "ros2": "a bag"}
"""Formats that are folders of files, and what stands there."""

DATASET = ("anchors.csv", "ranges.csv", "truth.csv")
"""The files of a dataset."""

_ANY: Mapping[str, str] = {}


def stem_of(log: Path) -> str:
    """What the names of a log's outputs begin with: `run` for run.mcap."""
    return log.name.removesuffix(ACTIVE).removesuffix(".mcap")


def beside(log: Path, name: str) -> Path:
    """The place of an output without -o: beside the log, with its name in front unless that is run.mcap."""
    stem = stem_of(log)
    return log.with_name(name if stem == "run" else f"{stem}.{name}")


def new_file(path: Path, formats: Mapping[str, str] = _ANY, *, force: bool) -> Path:
    """The file that -o names. formats: its suffixes, each with what it is for; all if empty.

    Raises UserError for another suffix, for a folder, for what stands in a file, and without `force` for a file that
    exists.
    """
    if formats and path.suffix not in formats:
        raise UserError(f"--output {path} must end with {_words(formats)}")
    if path.is_dir():
        raise UserError(f"--output {path} is a folder; name a file")
    refuse_in_file(path)
    if path.is_file() and not force:
        raise UserError(f"{path} exists; name another --output, or write over it with --force")
    return path


def _words(formats: Mapping[str, str]) -> str:
    return " or ".join(f"{suffix} {what}" for suffix, what in formats.items())


def new_folder_of(path: Path, names: Sequence[str], *, force: bool) -> Path:
    """The folder that -o names, for results of these names.

    Raises UserError where it is, looks like or stands in a file, and without `force` where it has one of them.
    """
    if path.is_file():
        raise UserError(f"--output {path} is a file, and is to be a folder; name a folder")
    if path.suffix in _FILES and not path.is_dir():
        bare = path.with_suffix("")
        raise UserError(f"--output {path} looks like a file, and is to be a folder; name one, as {bare}")
    refuse_in_file(path)
    there = next((name for name in names if (path / name).exists()), None)
    if there is not None and not force:
        raise UserError(f"{path / there} exists; name another --output, or write over it with --force")
    return path


def new_place(path: Path, kind: str, *, force: bool) -> Path:
    """The place that -o names for an export: a file, or a folder of files. Raises UserError as these."""
    if kind not in _FOLDERS:
        return new_file(path, force=force)
    if path.is_file():
        raise UserError(f"{path} is a file, and {kind} is a folder of {_FOLDERS[kind]}; name another --output")
    refuse_in_file(path)
    there = next((one for suffix in (kind, "mcap") for one in path.glob(f"*.{suffix}")), None)
    if there is not None and not force:
        raise UserError(f"{there} exists; name another --output, or write over it with --force")
    return path
