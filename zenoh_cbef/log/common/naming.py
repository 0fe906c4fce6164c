"""The names of a log's files, attachments and metadata."""

from __future__ import annotations

from pathlib import Path

LOGS = Path("logs")
"""The folder of runs, in the working directory."""

ACTIVE = ".active"
"""The suffix of a file that is still being written, or whose recorder was killed."""

SOURCE = "scenario.toml"
"""Attachment: the scenario as it was written."""

RESOLVED = "scenario.resolved.toml"
"""Attachment: the scenario as it is meant, with every key."""

RUN = "cbef.run"
"""Metadata record: what run it is."""

END = "cbef.end"
"""Metadata record: how the run ended; a log without one was cut off."""


def part_path(path: Path, number: int) -> Path:
    """The file of a log's part, from 1: run.mcap, run.2.mcap, run.3.mcap."""
    return path if number == 1 else path.with_name(f"{path.stem}.{number}{path.suffix}")


def left_active(path: Path) -> Path | None:
    """The file of a log that is being written, or that a killed recorder left; None where each part is whole."""
    number = 1
    while True:
        part = part_path(path, number)
        active = part.with_name(part.name + ACTIVE)
        if active.exists():
            return active
        if not part.exists():
            return None
        number += 1


def free_path(path: Path) -> Path:
    """The path, or one beside it, run-2.mcap, run-3.mcap, where a killed recorder left its file there."""
    found, number = path, 1
    while left_active(found) is not None or (number > 1 and found.exists()):
        number += 1
        found = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return found
