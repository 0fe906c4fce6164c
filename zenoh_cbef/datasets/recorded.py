"""Recordings that come with the package; docs/datasets.md says whose they are."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from zenoh_cbef.errors import UserError

PREFIX = "recorded:"
"""What a dataset's path begins with that names a recording of the package."""

_FOLDER = Path(str(files("zenoh_cbef.datasets") / "recordings"))


def dataset_folder(path: str | Path, base: Path = Path()) -> Path:
    """The folder that a dataset's path names, where relative paths start from a base.

    Raises UserError where the package has no recording of that name.
    """
    written = str(path)
    if not written.startswith(PREFIX):
        return base / Path(written).expanduser()
    name = written.removeprefix(PREFIX)
    known = sorted(each.name for each in _FOLDER.iterdir() if each.is_dir())
    if name not in known:
        raise UserError(f"no recording {name!r} comes with the package; there is {', '.join(known)}")
    return _FOLDER / name
