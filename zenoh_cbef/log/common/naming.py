"""The names of a log's files, attachments and metadata."""

from __future__ import annotations

from pathlib import Path

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
