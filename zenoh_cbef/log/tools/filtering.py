"""A part of a log as a log of its own."""

from __future__ import annotations

from pathlib import Path

from zenoh_cbef.log.mcap.writer import Compression
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.log.tools.output import OutputLog
from zenoh_cbef.log.tools.selection import Selection


def filter_log(
    log: Log,
    output: Path,
    selection: Selection,
    *,
    attachments: bool = True,
    metadata: bool = True,
    compression: Compression = "zstd",
) -> int:
    """Write the selected messages, and attachments and metadata unless told otherwise; returns how many messages."""
    wanted = selection.test()
    with OutputLog(output, compression) as new:
        for attachment in log.attached() if attachments else ():
            new.attach(attachment)
        for name, described in log.metadata.items() if metadata else ():
            new.describe(name, described)
        for message in log.messages():
            if wanted(message):
                new.add(message)
        return new.count
