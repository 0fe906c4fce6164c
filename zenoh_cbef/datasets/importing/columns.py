"""Which column of a CSV file is what: by the user's map, otherwise by the usual names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from zenoh_cbef.errors import UserError

USUAL: Mapping[str, tuple[str, ...]] = {
    "t": ("t", "time", "timestamp", "stamp", "sec", "seconds", "rostime", "datetime", "date"),
    "anchor": (
        "anchor_id",
        "anchor",
        "anchorid",
        "id",
        "name",
        "beacon",
        "node",
        "node_id",
        "station",
        "mac",
        "address",
    ),
    "range": ("range", "distance", "dist", "measurement", "tof_distance", "r", "d"),
    "x": ("x", "px", "pos_x", "position_x", "east", "easting"),
    "y": ("y", "py", "pos_y", "position_y", "north", "northing"),
    "z": ("z", "pz", "pos_z", "position_z", "up", "height", "altitude"),
}
"""Headers by what they mean, in small letters and without units. The first that a file has is taken."""

_UNIT = re.compile(r"[\s_]*[(\[][^)\]]*[)\]]$|_(?:mm|cm|km|ft|m|s|ms|us|ns|sec|nsec|usec)$")


def column_of(meaning: str, heads: Sequence[str], mapped: Mapping[str, str], file: str) -> int | None:
    """The place of the column with a meaning; None where none is named so.

    mapped: the user's headers by meaning ("range") or file and meaning ("truth.t"). Raises UserError where the user
    names a header that the file lacks.
    """
    for key in (f"{file}.{meaning}", meaning):
        if key in mapped and "*" not in mapped[key]:
            wanted = mapped[key].strip().lower()
            found = [place for place, head in enumerate(heads) if head.strip().lower() == wanted]
            if found:
                return found[0]
            if key != meaning:
                raise UserError(f"--map {key}={mapped[key]}: {file} has no such column; it has {', '.join(heads)}")
    plain = [_UNIT.sub("", head.strip().lower()).replace(" ", "_") for head in heads]
    return next((plain.index(name) for name in USUAL[meaning] if name in plain), None)


def wide_columns(heads: Sequence[str], mapped: Mapping[str, str]) -> dict[str, int]:
    """Where each anchor has a column of its own, as with --map range=d_*: their places by what * stands for."""
    pattern = mapped.get("ranges.range", mapped.get("range", ""))
    if "*" not in pattern:
        return {}
    shape = re.compile("(.+)".join(map(re.escape, pattern.split("*", 1))), re.IGNORECASE)
    return {match[1]: place for place, head in enumerate(heads) if (match := shape.fullmatch(head.strip()))}


def map_of(words: Sequence[str]) -> dict[str, str]:
    """From "range=dist" and "truth.t=stamp". Raises UserError where a word is neither."""
    found = {}
    for word in words:
        key, separator, header = word.partition("=")
        if not separator or not header or key.split(".")[-1] not in USUAL:
            raise UserError(
                f"--map {word!r} is not MEANING=COLUMN; the meanings are {', '.join(USUAL)}, as in range=dist"
            )
        found[key.strip()] = header.strip()
    return found
