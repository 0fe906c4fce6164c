"""The log of a run: everything that crossed the network, with the scenario, in one MCAP file or several."""

from __future__ import annotations

import errno
import json
import os
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

from zenoh_cbef import __version__
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import ACTIVE, END, RESOLVED, RUN, SOURCE, left_active, part_path
from zenoh_cbef.log.common.sequence import Sequences
from zenoh_cbef.log.mcap.writer import McapWriter
from zenoh_cbef.protocol.fields import LONGEST
from zenoh_cbef.protocol.keys import Address, address
from zenoh_cbef.protocol.kinds import MESSAGE_KINDS
from zenoh_cbef.protocol.messages import BadMessage, json_schema, unpack
from zenoh_cbef.protocol.short import ENCODING, SCHEMA, is_short, numbered
from zenoh_cbef.scenario.model import Record
from zenoh_cbef.writing import writing

UNKNOWN = "unknown"
"""The kind of data that is no message of a run."""

_MOST = 1 << 63
_NOWHERE = Address("", UNKNOWN, "no process")
_FREE, _LONGEST_KEY = 1000, 1000
"""Keys that no run has which a log names, likewise keys with names that processes chose, and characters of a key.

A file has numbers for 65535 channels. Those of the agents and the target always find room, as an agent's number has
at most three digits.
"""


_MSGPACK = "msgpack"

_Named = dict[bool, set[tuple[str, str]]]
"""Keys of processes with chosen names (False), and keys that no run has; with the encoding of their messages, "" of
others."""


class _Part:
    """One file of a log, under a temporary name until it is closed; it says by itself what run it is of."""

    def __init__(self, path: Path, settings: Record) -> None:
        self.path, self.active = path, path.with_name(path.name + ACTIVE)
        self.began = time.monotonic()
        self.writer = McapWriter(
            self.active,
            compression=settings.compression,
            chunk_bytes=settings.chunk_bytes,
            library=f"zenoh-cbef {__version__}",
        )
        self.channels: dict[tuple[str, str], tuple[Address, int]] = {}
        self._schemas: dict[str, int] = {}
        self.head_bytes = 0

    @property
    def count(self) -> int:
        """Messages in the file."""
        return 0 if self.writer.gone else self.writer.message_count

    def describe(self, source: str, resolved: str, run: Mapping[str, str]) -> None:
        self.writer.add_attachment(SOURCE, "application/toml", source.encode())
        self.writer.add_attachment(RESOLVED, "application/toml", resolved.encode())
        self.writer.add_metadata(RUN, run)
        self.writer.flush()
        self.head_bytes = self.writer.bytes_written

    def register(self, key: str, named: _Named, encoding: str) -> tuple[Address, int] | None:
        """The address and the channel of a key; None where the log, with the keys that it names so far, has no room.

        encoding: of its messages, "" where they are not ours.
        """
        at = address(key)
        free = at is None or at.chosen
        others = named[at is None]
        if len(key) > _LONGEST_KEY or (free and (key, encoding) not in others and len(others) == _FREE):
            return None
        if free:
            others.add((key, encoding))
        found = at if encoding else None
        at = found or _NOWHERE
        kind = at.kind
        name = SCHEMA if encoding == ENCODING else f"cbef.{kind.capitalize()}"
        schema = self._schemas.get(name)
        if schema is None:
            text = json.dumps(json_schema(MESSAGE_KINDS[kind]) if found else {})
            language, text = ("", "") if name == SCHEMA else ("jsonschema", text)
            schema = self._schemas[name] = self.writer.register_schema(name, language, text.encode())
        channel = self.writer.register_channel(key, encoding if found else "", schema)
        self.channels[key, encoding] = at, channel
        return at, channel

    def close(self, end: Mapping[str, str]) -> None:
        self.writer.add_metadata(END, end)
        self.writer.close()
        self.active.rename(self.path)


class _Label(NamedTuple):
    seq: int
    sent: int
    sender: str
    encoding: str = _MSGPACK


def _label(key: str, data: bytes) -> _Label | None:
    """What an MCAP record repeats of a message; None where it is no message of ours."""
    try:
        message = unpack(data)
    except BadMessage:
        return _short_label(key, data)
    seq, sent, sender = message.get("seq"), message.get("sent"), message.get("from")
    if type(seq) is not int or type(sent) is not int or type(sender) is not str:
        return None
    return _Label(seq, sent, sender) if 0 <= seq < _MOST and 0 <= sent < _MOST and len(sender) <= LONGEST else None


def _short_label(key: str, data: bytes) -> _Label | None:
    at = address(key)
    if at is None or not is_short(data, at):
        return None
    seq, sent = numbered(data)
    return _Label(seq, sent, at.owner, ENCODING) if sent < _MOST else None


class RunLog:
    """A log that is being written. One thread at a time.

    Where settings.rotate_bytes or rotate_seconds is reached, a new file begins, complete by itself. A write that fails
    (disk full) drops what it held and is named in `failure`; what was written before stays readable, and later writes
    are tried again. Where the file itself was removed, all that it held is lost, and a new one is tried. missing: gaps
    in the senders' numbers. dropped: messages that came and are not in the log. foreign: messages that were not
    written, as they were on more keys than a log names that no run has, or whose names processes chose. Raises
    UserError where a log is there, also one that a killed recorder left.
    """

    def __init__(self, path: Path, settings: Record) -> None:
        self.path, self._settings = path, settings
        for taken in (path, part_path(path, 2)):
            if taken.exists():
                raise UserError(f"{taken} exists and logs are never overwritten; choose another name, or move it away")
        if (left := left_active(path)) is not None:
            raise UserError(
                f"{left} is being written, or its recorder was killed, and logs are never overwritten; choose another "
                "name, or 'recover' what is in it and move it away"
            )
        with writing(path, "choose another place for the log"):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._part = _Part(path, settings)
        self._number = 1
        self._description: tuple[str, str, Mapping[str, str]] = "", "", {}
        self._sequences = Sequences()
        self._named: _Named = {False: set(), True: set()}
        self._taken, self._closed_count = 0, 0
        self._rotate_bytes = settings.rotate_bytes or 1 << 63
        self._rotate_seconds = settings.rotate_seconds or float("inf")
        self.failure = ""
        self.foreign = 0

    @property
    def active(self) -> Path:
        """The file that is being written."""
        return self._part.active

    @property
    def count(self) -> int:
        """Messages that are in the log."""
        return self._closed_count + self._part.count

    @property
    def dropped(self) -> int:
        """Messages that came and are not in the log: they could not be written, or their file was removed."""
        return self._taken - self.count

    @property
    def missing(self) -> int:
        """Numbers that are missing in the sequences of all senders."""
        return self._sequences.missing

    def describe(self, *, source: str, resolved: str, run: Mapping[str, str]) -> None:
        """Attach the scenario and say which run this is. Raises UserError where it cannot be written."""
        self._description = source, resolved, run
        try:
            self._part.describe(*self._described())
        except OSError as error:
            self.active.unlink(missing_ok=True)
            raise UserError(f"cannot write {self.path}: {error.strerror}; make room, or choose another place") from None

    def add(self, key: str, data: bytes, log_time: int) -> str:
        """Write one message as it came; returns its kind, UNKNOWN where it is no message of ours."""
        label, part = _label(key, data), self._part
        encoding = "" if label is None else label.encoding
        place = part.channels.get((key, encoding)) or part.register(key, self._named, encoding)
        if place is None:
            self.foreign += 1
            return UNKNOWN
        at, channel = place
        self._taken += 1
        try:
            if label is not None:
                part.writer.add_message(channel, log_time, label.sent, label.seq, data)
            else:
                part.writer.add_message(channel, log_time, log_time, 0, data)
        except OSError as error:
            self._fail(error)
        if label is not None and at.is_of(label.sender):
            self._sequences.of(key, label.sender).take(label.seq)
        if part.writer.bytes_written - part.head_bytes >= self._rotate_bytes:
            self._rotate()
        return at.kind

    def flush(self, *, sync: bool = False) -> None:
        """Hand everything so far to the operating system; with sync, to the disk. A new file begins if it is time."""
        try:
            self._part.writer.flush(sync=sync)
        except OSError as error:
            self._fail(error)
        if self._part.writer.gone:
            self._fail(OSError(errno.ENOENT, os.strerror(errno.ENOENT)))
            self._rotate()
        elif time.monotonic() - self._part.began >= self._rotate_seconds:
            self._rotate()

    def close(self, end: Mapping[str, str]) -> None:
        """Write the end record, close the file and give it its name; it keeps its temporary one where that fails."""
        self._close(self._part, end)

    def abandon(self) -> None:
        """Close the file without an end record; it keeps its temporary name."""
        self._part.writer.close()

    def lacks(self, key: str, sender: str, sent: int) -> bool:
        """Whether fewer than `sent` messages of a sender on a key have come so far."""
        return self._sequences.next(key, sender) < sent

    def gaps(self, of: str | None = None) -> list[tuple[str, str, int, int]]:
        """Sender, key, first and last number of what is missing, the first stretches of it; of one sender, or all."""
        found = [(name, one) for name, one in self._sequences.all_of(of) if one.missing]
        return [(sender, key, *gap) for (key, sender), sequence in found for gap in sequence.gaps]

    def wants(self, key: str, sender: str, data: bytes) -> bool:
        """Whether a message is one of a sender's that are missing."""
        label, found = _label(key, data), self._sequences.find(key, sender)
        return label is not None and label.sender == sender and found is not None and found.lacks(label.seq)

    def _fail(self, error: OSError) -> None:
        self.failure = f"cannot write {self._part.active}: {error.strerror}"

    def _close(self, part: _Part, end: Mapping[str, str]) -> None:
        for step in (part.writer.flush, partial(part.close, end), part.writer.close):
            # What does not fit is left out: the file is closed without it, or at least not kept open.
            try:
                step()
            except OSError as error:
                self._fail(error)

    def _described(self) -> tuple[str, str, Mapping[str, str]]:
        source, resolved, run = self._description
        return source, resolved, {**run, "part": str(self._number)}

    def _rotate(self) -> None:
        """Begin the next file, and close this one; this one goes on where the next cannot be written."""
        old, self._number = self._part, self._number + 1
        path = part_path(self.path, self._number)
        try:
            self._part = _Part(path, self._settings)
            self._part.describe(*self._described())
        except OSError as error:
            self._fail(error)
            self._part, self._number = old, self._number - 1
            path.with_name(path.name + ACTIVE).unlink(missing_ok=True)
            return
        self._close(old, {"status": "rotated", "log": str(old.path)})
        self._closed_count += old.count
