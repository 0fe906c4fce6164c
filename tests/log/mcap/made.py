"""Logs with noise in them, and files altered."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path
from typing import Any

from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.writer import Compression

COMPRESSIONS: tuple[Compression, ...] = ("zstd", "lz4", "none")
MESSAGES = 300
"""In the log of the fixture."""


def chance(seed: int) -> random.Random:
    return random.Random(seed)  # noqa: S311


def rows(file: McapFile) -> list[tuple[Any, ...]]:
    return [(m.channel.topic, *m[1:]) for m in file.messages()]


def altered(data: bytes | bytearray) -> McapFile:
    """Open a file of this content, of which nothing is left when it is done with."""
    with tempfile.NamedTemporaryFile(suffix=".mcap") as stream:
        stream.write(data)
        stream.flush()
        return McapFile(Path(stream.name))
