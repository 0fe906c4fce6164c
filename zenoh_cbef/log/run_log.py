"""The log of a run: everything that crossed the network, with the scenario, in one MCAP file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from zenoh_cbef import __version__
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.mcap_writer import McapWriter
from zenoh_cbef.protocol.keys import address
from zenoh_cbef.protocol.messages import BadMessage, json_schema, unpack
from zenoh_cbef.scenario.model import Record

ACTIVE = ".active"
SOURCE = "scenario.toml"
RESOLVED = "scenario.resolved.toml"
RUN = "cbef.run"
END = "cbef.end"
_MOST = 1 << 63


class RunLog:
    """A log that is being written, under a temporary name until it is closed. One thread at a time."""

    def __init__(self, path: Path, settings: Record) -> None:
        self.path = path
        self.active = path.with_name(path.name + ACTIVE)
        if path.exists():
            raise UserError(f"{path} exists and logs are never overwritten; choose another name, or move it away")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = McapWriter(
                self.active,
                compression=settings.compression,
                chunk_bytes=settings.chunk_bytes,
                library=f"zenoh-cbef {__version__}",
            )
        except OSError as error:
            raise UserError(f"cannot write {path}: {error.strerror}; choose another place for the log") from None
        self._channels: dict[tuple[str, bool], tuple[str, int]] = {}
        self._schemas: dict[str, int] = {}
        self._next_seq: dict[tuple[str, str], int] = {}
        self.missing = 0

    @property
    def count(self) -> int:
        """Messages written."""
        return self._writer.message_count

    def describe(self, *, source: str, resolved: str, run: Mapping[str, str]) -> None:
        """Attach the scenario and say which run this is."""
        self._writer.add_attachment(SOURCE, "application/toml", source.encode())
        self._writer.add_attachment(RESOLVED, "application/toml", resolved.encode())
        self._writer.add_metadata(RUN, run)
        self._writer.flush()

    def add(self, key: str, data: bytes, log_time: int) -> str:
        """Write one message as it came; returns its kind, "unknown" where it is no message of ours."""
        try:
            message = unpack(data)
            seq, sent, sender = message["seq"], message["sent"], message["from"]
            known = type(seq) is int and type(sent) is int and 0 <= seq < _MOST and 0 <= sent < _MOST
        except (BadMessage, KeyError):
            known = False
        kind, channel = self._channels.get((key, known)) or self._register(key, known)
        if not known:
            self._writer.add_message(channel, log_time, log_time, 0, data)
            return kind
        self._writer.add_message(channel, log_time, sent, seq, data)
        name = (key, str(sender))
        expected = self._next_seq.get(name, 0)
        if seq >= expected:
            self.missing += seq - expected
            self._next_seq[name] = seq + 1
        return kind

    def flush(self, *, sync: bool = False) -> None:
        """Hand everything so far to the operating system; with sync, to the disk."""
        self._writer.flush(sync=sync)

    def close(self, end: Mapping[str, str]) -> None:
        """Write the end record, close the file and give it its name."""
        self._writer.add_metadata(END, end)
        self._writer.close()
        self.active.rename(self.path)

    def abandon(self) -> None:
        """Close the file without an end record; it keeps its temporary name."""
        self._writer.close()

    def lacks(self, key: str, sender: str, sent: int) -> bool:
        """Whether fewer than `sent` messages of a sender on a key have come so far."""
        return self._next_seq.get((key, sender), 0) < sent

    def _register(self, key: str, known: bool) -> tuple[str, int]:
        found = address(key) if known else None
        kind = found.kind if found else "unknown"
        schema = self._schemas.get(kind)
        if schema is None:
            text = json_schema(kind) if found else {}
            schema = self._writer.register_schema(f"cbef.{kind.capitalize()}", "jsonschema", json.dumps(text).encode())
            self._schemas[kind] = schema
        channel = self._writer.register_channel(key, "msgpack" if found else "", schema)
        self._channels[key, known] = kind, channel
        return kind, channel
