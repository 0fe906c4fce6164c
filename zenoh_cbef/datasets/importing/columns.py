"""Which column of a CSV file is what: by the user's map, otherwise by the usual names."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence

from zenoh_cbef.errors import UserError

FILES: Mapping[str, tuple[str, ...]] = {
    "anchors": ("anchor", "beacon", "node", "station", "landmark"),
    "truth": ("truth", "gt", "mocap", "vicon", "rtk", "reference", "pose"),
    "ranges": ("range", "distance", "uwb", "tof", "twr", "measure"),
}
"""By what words in its name a file of a folder is known, in this order."""

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
    """Where each anchor has a column of its own, as with --map range=d_*: their places by what * stands for.

    Raises UserError where no column is named so.
    """
    pattern = mapped.get("ranges.range", mapped.get("range", ""))
    if "*" not in pattern:
        return {}
    shape = re.compile("(.+)".join(map(re.escape, pattern.split("*", 1))), re.IGNORECASE)
    found = {match[1]: place for place, head in enumerate(heads) if (match := shape.fullmatch(head.strip()))}
    if not found:
        raise UserError(f"--map range={pattern}: no column is named so; there are {', '.join(heads)}")
    return found


def wide_pattern(heads: Sequence[str]) -> str | None:
    """The pattern that three columns and more have in common, as d_*; None where none have.

    The longest of those that most columns have; names, as N1 and N2, may begin alike, so one up to a separator first.
    """
    found = Counter(head[:length] for head in heads for length in range(1, len(head)))
    alike = [start for start, many in found.items() if many > 2]
    best = max(alike, key=lambda start: (found[start], not start[-1].isalnum(), len(start)), default=None)
    return None if best is None else f"{best}*"


def refuse_unknown(mapped: Mapping[str, str], heads: Sequence[str]) -> None:
    """Raise UserError for a header that the user names for any file, and that none has. heads: those of all files."""
    known = {head.strip().lower() for head in heads}
    for key, header in mapped.items():
        if "." not in key and "*" not in header and header.lower() not in known:
            raise UserError(f"--map {key}={header}: no file has such a column; there are {', '.join(heads)}")


def is_column(key: str) -> bool:
    """Whether a key is a meaning, or that of a file, as "range" and "truth.t"."""
    file, _, meaning = key.rpartition(".")
    return meaning in USUAL and file in {"", *FILES}


def map_of(words: Sequence[str]) -> dict[str, str]:
    """From "range=dist" and "truth.t=stamp". Raises UserError where a word is neither."""
    found = {}
    for word in words:
        key, separator, header = word.partition("=")
        if not separator or not header or not is_column(key.strip()):
            raise UserError(
                f"--map {word!r} is not MEANING=COLUMN; the meanings are {', '.join(USUAL)}, as in range=dist, "
                f"or with a file ({', '.join(FILES)}), as in truth.t=stamp"
            )
        found[key.strip()] = header.strip()
    return found
