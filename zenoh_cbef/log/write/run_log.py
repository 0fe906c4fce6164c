"""The log of a run: everything that crossed the network, with the scenario, in one MCAP file or several."""

from __future__ import annotations

import errno
import json
import os
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from zenoh_cbef import __version__
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import ACTIVE, END, RESOLVED, RUN, SOURCE, left_active, part_path
from zenoh_cbef.log.common.sequence import Sequences
from zenoh_cbef.log.mcap.writer import McapWriter
from zenoh_cbef.log.write.labels import Label, label_of
from zenoh_cbef.protocol.keys import Address, address
from zenoh_cbef.protocol.kinds import MESSAGE_KINDS
from zenoh_cbef.protocol.messages import json_schema
from zenoh_cbef.protocol.ring import Said
from zenoh_cbef.protocol.short import ENCODING, SCHEMA
from zenoh_cbef.scenario.model import Record
from zenoh_cbef.writing import make_folder, must_be_new, writing

UNKNOWN = "unknown"
"""The kind of data that is no message of a run."""

_NOWHERE = Address("", UNKNOWN, "no process")
_FREE, _LONGEST_KEY = 1000, 1000
"""Keys that no run has which a log names, likewise keys with names that processes chose, and characters of a key.

A file has numbers for 65535 channels. Those of the agents and the target always find room, as an agent's number has
at most three digits.
"""


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
            must_be_new(taken, "choose another name, or move it away")
        if (left := left_active(path)) is not None:
            raise UserError(
                f"{left} is being written, or its recorder was killed, and logs are never overwritten; choose another "
                "name, or 'recover' what is in it and move it away"
            )
        make_folder(path.parent, "choose another place for the log")
        with writing(path, "choose another place for the log"):
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
        label = label_of(key, data)
        place = self._place(key, label)
        if place is None:
            self.foreign += 1
            return UNKNOWN
        at, channel = place
        seq, sent = (0, log_time) if label is None else label[:2]
        self._taken += 1
        try:
            self._part.writer.add_message(channel, log_time, sent, seq, data)
        except OSError as error:
            self._fail(error)
        if label is not None and at.is_of(label.sender):
            self._sequences.of(key, label.sender).take(seq)
        self._rotate_where_full()
        return at.kind

    def add_all(self, keys: Sequence[str], said: Sequence[Said], log_time: int) -> None:
        """Write what a process has left in its ring, each message on one of its keys.

        The first message of each key is read; where it is what its frame says, the other frames are believed.
        """
        places = {}
        for kind in {one[0] for one in said}:
            own = [one for one in said if one[0] == kind]
            label = label_of(keys[kind], own[0][3])
            place = self._place(keys[kind], label)
            if label is None or place is None or label[:2] != own[0][1:3] or not place[0].is_of(label.sender):
                for kind_, _, _, data in said:
                    self.add(keys[kind_], data, log_time)
                return
            places[kind] = place[1], self._sequences.of(keys[kind], label.sender), [one[1] for one in own]
        channels, add = {kind: channel for kind, (channel, _, _) in places.items()}, self._part.writer.add_message
        self._taken += len(said)
        for kind, number, sent, data in said:
            try:
                add(channels[kind], log_time, sent, number, data)
            except OSError as error:
                self._fail(error)
        for _, sequence, numbers in places.values():
            sequence.take_all(numbers)
        self._rotate_where_full()

    def _place(self, key: str, label: Label | None) -> tuple[Address, int] | None:
        encoding = "" if label is None else label.encoding
        return self._part.channels.get((key, encoding)) or self._part.register(key, self._named, encoding)

    def _rotate_where_full(self) -> None:
        if self._part.writer.bytes_written - self._part.head_bytes >= self._rotate_bytes:
            self._rotate()

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
        label, found = label_of(key, data), self._sequences.find(key, sender)
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
            path.parent.mkdir(parents=True, exist_ok=True)  # its folder may have been removed
            self._part = _Part(path, self._settings)
            self._part.describe(*self._described())
        except OSError as error:
            self._fail(error)
            self._part, self._number = old, self._number - 1
            path.with_name(path.name + ACTIVE).unlink(missing_ok=True)
            return
        self._close(old, {"status": "rotated", "log": str(old.path)})
        self._closed_count += old.count
