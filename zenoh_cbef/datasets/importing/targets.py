"""Files with the ranges of several targets, of which a dataset has one."""

from __future__ import annotations

from collections.abc import Sequence

from zenoh_cbef.errors import UserError
from zenoh_cbef.words import listed

_TARGETS = ("tag", "tag_id", "tagid", "target", "target_id", "mobile", "mobile_id", "rover", "rover_id")
"""Headers of columns that name the target, in small letters."""

_SHOWN = 5


def several_targets(heads: Sequence[str], rows: Sequence[Sequence[str]], file: str) -> list[str]:
    """A note on ranges of several targets, which are taken for those of one; none where a column names one or none."""
    for place, head in enumerate(heads):
        names = dict.fromkeys(row[place].strip() for row in rows) if head.strip().lower() in _TARGETS else {}
        if len(names) > 1:
            said = f"{file} has ranges of {len(names)} targets, which are taken for those of one"
            return [f"{said}; import those of one with --only {head.strip()}={next(iter(names))}"]
    return []


def rows_of(only: str, heads: Sequence[str], rows: Sequence[list[str]], file: str) -> list[list[str]]:
    """The rows of one target, as "tag=7" says. Raises UserError where it names no column, or no row of it."""
    head, separator, name = (part.strip() for part in only.partition("="))
    places = [place for place, each in enumerate(heads) if each.strip().lower() == head.lower()]
    if not separator or not places:
        raise UserError(f"--only {only!r} is not COLUMN=VALUE of a column of {file}, which has {', '.join(heads)}")
    found = [row for row in rows if row[places[0]].strip() == name]
    if not found:
        names = list(dict.fromkeys(row[places[0]].strip() for row in rows))
        known = listed(names[:_SHOWN]) + " and others" * (len(names) > _SHOWN)
        raise UserError(f"--only {only}: no row of {file} has that; {head} is {known}")
    return found
