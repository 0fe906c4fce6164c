"""The paths that a program names."""

from __future__ import annotations

import os
from pathlib import Path

from zenoh_cbef.errors import UserError


def path_of(named: object, what: str) -> Path:
    """The path that a text or a path names; what: what it is of. Raises UserError for anything else."""
    if not isinstance(named, str | os.PathLike):
        raise UserError(f"{named!r} is no path of {what}; give a text or a pathlib.Path")
    return Path(named)
