"""A log that is made of messages of other logs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Self

from mcap import records

from zenoh_cbef import __version__
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import ACTIVE
from zenoh_cbef.log.mcap.contents import Channel, RawMessage
from zenoh_cbef.log.mcap.writer import Compression, McapWriter
from zenoh_cbef.writing import make_folder, must_be_new, writing


class OutputLog:
    """A new log, which gets its name when it is whole; one that fails leaves nothing behind.

    Raises UserError where it cannot be written, or exists.
    """

    def __init__(self, path: Path, compression: Compression = "zstd") -> None:
        self.path, self._active = path, path.with_name(path.name + ACTIVE)
        for taken in (path, self._active):
            must_be_new(taken, "name another --output")
        make_folder(path.parent, "name another --output")
        with writing(path, "name another --output"):
            self._writer = McapWriter(self._active, compression=compression, library=f"zenoh-cbef {__version__}")
        # By identity first: equal channels are met as many objects, and each is compared once.
        self._known: dict[int, tuple[Channel, int]] = {}
        self._channels: list[tuple[Channel, int]] = []
        self._schemas: dict[tuple[str, str, bytes], int] = {("", "", b""): 0}

    @property
    def count(self) -> int:
        """Messages written."""
        return self._writer.message_count

    def add(self, message: RawMessage) -> None:
        """Write a message as it is."""
        found = self._known.get(id(message.channel))
        _, number = found or self._register(message.channel)
        self._writer.add_message(number, message.log_time, message.publish_time, message.sequence, message.data)

    def attach(self, attachment: records.Attachment) -> None:
        """Write an attachment as it is."""
        self._writer.add_attachment(attachment.name, attachment.media_type, attachment.data, attachment.log_time)

    def describe(self, name: str, metadata: Mapping[str, str]) -> None:
        """Write metadata."""
        self._writer.add_metadata(name, metadata)

    def discard(self) -> None:
        """Remove the unfinished file."""
        self._writer.close()
        self._active.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, value: BaseException | None, _trace: object) -> None:
        if not self._active.exists():
            return
        try:
            self._writer.close()
            if value is None:
                self._active.rename(self.path)
        except OSError as error:
            value = value or error
        if value is not None:
            self._active.unlink(missing_ok=True)
        if isinstance(value, OSError):
            raise UserError(
                f"cannot write {self.path}: {value.strerror}; make room, or name another --output"
            ) from None

    def _register(self, channel: Channel) -> tuple[Channel, int]:
        number = next((number for known, number in self._channels if _same(known, channel)), None)
        if number is None:
            schema = (channel.schema_name, channel.schema_encoding, channel.schema_data)
            if schema not in self._schemas:
                self._schemas[schema] = self._writer.register_schema(*schema)
            encoding, metadata = channel.message_encoding, channel.metadata
            number = self._writer.register_channel(channel.topic, encoding, self._schemas[schema], metadata)
            self._channels.append((channel, number))
        # The channel is kept as long as its identity stands for it.
        self._known[id(channel)] = channel, number
        return channel, number


def _same(one: Channel, other: Channel) -> bool:
    mine, its = (
        (each.topic, each.message_encoding, each.schema_name, each.schema_encoding, each.schema_data, each.metadata)
        for each in (one, other)
    )
    return mine == its
