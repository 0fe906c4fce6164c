"""Makes a whole log from all that can still be read of a damaged one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.mcap.contents import NotMcapError
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.writer import Compression
from zenoh_cbef.log.tools.output import OutputLog


@dataclass(frozen=True)
class Recovered:
    """What was recovered, and one sentence for each thing that was lost."""

    messages: int
    attachments: int
    metadata: int
    lost: list[str]

    @property
    def exit_status(self) -> int:
        """0 nothing lost, 3 something lost, 1 nothing recovered."""
        if not (self.messages or self.attachments or self.metadata):
            return 1
        return 3 if self.lost else 0


def recover(source: Path, output: Path, compression: Compression = "zstd", *, growing: bool = False) -> Recovered:
    """Write what is sound in a log into a new one, in the same order, with its index; the old one is left alone.

    growing: the old one is still being written, so that it has no end is no loss. Raises UserError where the new one
    exists or cannot be written, or the old one cannot be read at all.
    """
    try:
        file = McapFile(source, headless=True)
    except NotMcapError as error:
        return Recovered(0, 0, 0, [str(error)])
    except OSError as error:
        raise UserError(f"cannot read {source}: {error.strerror}") from None
    with OutputLog(output, compression) as new:
        attachments = 0
        for attachment in file.attached():
            new.attach(attachment)
            attachments += 1
        described = [(found.name, found.metadata) for found in file.described()]
        # The run's metadata stay at the start, so that a reader finds them if the new log is cut in turn.
        for name, metadata in described[:1]:
            new.describe(name, metadata)
        for message in file.messages():
            new.add(message)
        for name, metadata in described[1:]:
            new.describe(name, metadata)
        lost = [*file.lost]
        if not (file.closed or growing):
            lost.append("the file ends without its closing record: what was not written by then is lost")
        result = Recovered(new.count, attachments, len(described), lost)
        if result.exit_status == 1:
            new.discard()
    return result
