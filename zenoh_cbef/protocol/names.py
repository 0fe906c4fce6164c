"""Which names of runs and of processes a user may give."""

from __future__ import annotations

import re

from zenoh_cbef.errors import UserError

LONGEST = 200
"""Characters of a run's name, which is also that of a folder and of a file."""

_NAME = re.compile(r"\w[\w.-]*")


def check_run(name: str | None) -> str | None:
    """What --run gives, or None. Raises UserError; as the option's callback before the verb does anything."""
    return name if name is None else checked(name, "--run")


def checked(name: str, option: str) -> str:
    """A name that can be part of keys, folders and files. Raises UserError."""
    if not _NAME.fullmatch(name):
        raise UserError(
            f"{option} {name!r:.60} is no {option.removeprefix('--')} name; use letters, digits, dot, dash and "
            "underscore, and begin with neither dot nor dash"
        )
    if len(name) > LONGEST:
        raise UserError(f"{option} {name[:30]!r}... has {len(name)} characters; use at most {LONGEST}")
    return name
