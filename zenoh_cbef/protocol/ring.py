"""A ring in a file that processes map: what one process says, for recorders on its host.

The writer stores a message's bytes and a frame that says what they are, then one word, the head: how far it has written
since it began. A reader looks no further than the head, so a message is there whole or not at all, whenever the writer
is killed. What it left stays in the file when it is dead. The checksum covers place and frame, too. So where a
processor shows the stores in another order, or the bytes are those of an older lap, the reader finds nothing there yet.

A reader's place is in the file as well: the next recorder goes on from there. The writer writes over nothing that a
reader still needs.
"""

from __future__ import annotations

import fcntl
import mmap
import os
import struct
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from zlib import crc32

_MAGIC = int.from_bytes(b"cbefrng3", "little")
_WORD = 8
_AT_MAGIC, _AT_SIZE, _AT_HEAD, _AT_LEFT, _AT_NAMES = range(5)
"""Words at the beginning of the file: what it is, bytes of the ring, the head, whether its writer has left it for good,
and bytes of the names."""
_SLOTS, _SLOT_WORDS, _FIRST_SLOT = 8, 8, 32
"""Readers that a ring can have: for each a line of eight words, its tag (0: free) and its place."""
_STARTS = range(_FIRST_SLOT, _FIRST_SLOT + _SLOTS * _SLOT_WORDS, _SLOT_WORDS)
_NAMES_BYTE, DATA_BYTE = 1024, 4096
"""Where the names of what is in the ring begin, and where the ring; later, by whole pages, where these are many."""
_FRAME = struct.Struct("=IIQQ")
"""In front of a message: its kind and length in one word of 32 bits, its checksum, its number, its sending time."""
FRAME_BYTES = _FRAME.size
_KIND_SHIFT, _LENGTH = 21, (1 << 21) - 1
_SKIP = (1 << 11) - 1
_SKIPPED = _SKIP << _KIND_SHIFT
_32_BITS = (1 << 32) - 1
LEAST_BYTES = 1 << 12

Said = tuple[int, int, int, bytes]
"""A message in a ring: its kind, a number of the ring's names; its sender's number and sending time (ns); its bytes."""


class RingError(Exception):
    """The file is no ring, or the ring has no room for another reader."""


def _data_byte(names: int) -> int:
    """Where a ring begins that has names of so many bytes."""
    return max(DATA_BYTE, -(-(_NAMES_BYTE + names) // DATA_BYTE) * DATA_BYTE)


def _is_held(file: int) -> bool:
    """Whether another open file holds the lock of this one's."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    fcntl.flock(file, fcntl.LOCK_UN)
    return False


def is_written(path: Path) -> bool:
    """Whether the process that writes a ring, or holds another file of the folder, is still there."""
    try:
        file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        return _is_held(file)
    finally:
        os.close(file)


def fill_of(path: Path) -> float:
    """The part of a ring that is not free; 0.0 where it is gone. For one who only looks."""
    try:
        with path.open("rb") as file:
            words = memoryview(file.read(_NAMES_BYTE)).cast("Q")
        places = [words[start + 1] for start in _STARTS if words[start]]
        return (words[_AT_HEAD] - min(places, default=0)) / words[_AT_SIZE]
    except (OSError, TypeError, IndexError, ZeroDivisionError):
        return 0.0


class RingWriter:
    """The end that one thread writes to.

    path: the file, which is there under this name when it is complete. names: what kinds of
    messages there are. size: bytes of the ring, of which the host gives all at once, so that a full disk cannot end the
    writer later. is_read: whether the reader with a tag is alive. Raises OSError.
    """

    def __init__(self, path: Path, names: Sequence[str], size: int, is_read: Callable[[int], bool]) -> None:
        self.path, self._is_read = path, is_read
        self._size = max(size, LEAST_BYTES) & -_WORD
        text = "\n".join(names).encode()
        if len(names) >= _SKIP:
            raise OSError("the names of what is in a ring have no room in it")
        self._begin = _data_byte(len(text))
        new = path.with_suffix(".new")
        self._file = os.open(new, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        try:
            left = self._begin + self._size
            while left:
                left -= os.write(self._file, bytes(min(left, 1 << 20)))
            fcntl.flock(self._file, fcntl.LOCK_EX)
            self._map = mmap.mmap(self._file, self._begin + self._size)
            self._words = memoryview(self._map).cast("Q")
            self._words[_AT_SIZE], self._words[_AT_NAMES] = self._size, len(text)
            self._map[_NAMES_BYTE : _NAMES_BYTE + len(text)] = text
            self._words[_AT_MAGIC] = _MAGIC
            new.rename(path)
        except BaseException:
            os.close(self._file)
            new.unlink(missing_ok=True)
            raise
        self._head, self._until = 0, self._size

    def write(self, kind: int, number: int, sent: int, data: bytes) -> bool:
        """Leave a message of a kind, a number of `names`; False where there is no room for it.

        number: its sender's for it; sent: when, ns since the Unix epoch.
        """
        head, length = self._head, len(data)
        need = FRAME_BYTES + length + _WORD - 1 & -_WORD
        at = head % self._size
        rest = self._size - at
        skip = rest if need > rest else 0
        if head + skip + need > self._until and not self._make_room(head + skip + need):
            return False
        if skip >= FRAME_BYTES:  # where not even a frame has room, the reader knows
            _FRAME.pack_into(self._map, self._begin + at, _SKIPPED, head + _SKIPPED & _32_BITS, 0, 0)
        if skip:
            head, at = head + skip, 0
        at += self._begin
        begin, word = at + FRAME_BYTES, kind << _KIND_SHIFT | length
        self._map[begin : begin + length] = data
        _FRAME.pack_into(self._map, at, word, crc32(data, head + word + number + sent & _32_BITS), number, sent)
        self._head = head + need
        self._words[_AT_HEAD] = self._head  # one store of a word: the message is there
        return True

    @property
    def readers(self) -> bool:
        """Whether any reader of the ring is alive."""
        return any(self._is_read(tag) for tag, _ in self._places())

    def _places(self) -> list[tuple[int, int]]:
        """Tag and word of the place of each reader."""
        return [(self._words[start], start + 1) for start in _STARTS if self._words[start]]

    def _make_room(self, until: int) -> bool:
        """Learn how far readers have got. One that is gone is forgotten where another has got further."""
        places = self._places()
        if any(until - self._words[at] > self._size for _, at in places):
            living = [at for tag, at in places if self._is_read(tag)]
            gone = [at for _, at in places if at not in living]
            for at in gone if living else ():
                self._words[at - 1] = 0
            places = self._places()
        read = min((self._words[at] for _, at in places), default=0)
        self._until = read + self._size
        return until <= self._until

    def leave(self) -> None:
        """Say that no more comes: readers hear the rest elsewhere, or there is none."""
        self._words[_AT_LEFT] = 1

    def close(self, *, remove: bool) -> None:
        """Let go of the ring. remove: the file, too, as no reader is left."""
        self._words.release()
        self._map.close()
        if remove:
            self.path.unlink(missing_ok=True)
        os.close(self._file)


class RingReader:
    """The end of one reader. tag: which, any number but 0; one reader at a time. Raises RingError, OSError.

    names: what kinds of messages there are.
    A reader whose tag the ring does not know begins with the oldest message that no reader has taken.
    """

    def __init__(self, path: Path, tag: int, is_read: Callable[[int], bool]) -> None:
        self.path, self._tag = path, tag
        self._file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        try:
            length = os.fstat(self._file).st_size
            if length <= DATA_BYTE:
                raise RingError(f"{path} is no ring")
            self._map = mmap.mmap(self._file, length)
        except BaseException:
            os.close(self._file)
            raise
        self._words = memoryview(self._map).cast("Q") if not length % _WORD else None
        named = 0 if self._words is None else min(self._words[_AT_NAMES], length - _NAMES_BYTE)
        self._begin = _data_byte(named)
        self._size = length - self._begin
        if self._words is None or self._words[_AT_MAGIC] != _MAGIC or self._words[_AT_SIZE] != self._size:
            self.close()
            raise RingError(f"{path} is no ring")
        text = self._map[_NAMES_BYTE : _NAMES_BYTE + named]
        self.names = text.decode(errors="replace").split("\n")
        try:
            self._slot = self._claim(tag, is_read)
        except RingError:
            self.close()
            raise
        self._place = self._words[self._slot + 1]

    def _claim(self, tag: int, is_read: Callable[[int], bool]) -> int:
        words = self._known()
        for start in _STARTS:
            if words[start] == tag:
                return start
        oldest = min((words[start + 1] for start in _STARTS if words[start]), default=0)
        for start in _STARTS:
            if not words[start] or not is_read(words[start]):
                words[start] = 0
                words[start + 1] = oldest
                words[start] = tag
                return start
        raise RingError(f"{self.path} has {_SLOTS} readers")

    def _known(self) -> memoryview[int]:
        if self._words is None:
            raise RingError(f"{self.path} is no ring")
        return self._words

    def read(self, most: int) -> list[Said]:
        """The next messages, at most so many. What is not whole yet is not there."""
        found: list[Said] = []
        place, head, size, content, kinds = self._place, self._known()[_AT_HEAD], self._size, self._map, len(self.names)
        if head - place > size:  # The writer forgot a reader that was taken for dead.
            place = head
        while place < head and len(found) < most:
            at = place % size
            if size - at < FRAME_BYTES:
                place += size - at
                continue
            begin = self._begin + at + FRAME_BYTES
            word, checksum, number, sent = _FRAME.unpack_from(content, begin - FRAME_BYTES)
            length = word & _LENGTH
            data = content[begin : begin + length]
            if len(data) != length or crc32(data, place + word + number + sent & _32_BITS) != checksum:
                break
            if word == _SKIPPED:
                place += size - at
                continue
            place += FRAME_BYTES + length + _WORD - 1 & -_WORD
            if (kind := word >> _KIND_SHIFT) < kinds:
                found.append((kind, number, sent, data))
        self._place = place
        return found

    def pass_over(self) -> None:
        """Go on behind what cannot be read."""
        self._place = self._known()[_AT_HEAD]

    def save(self) -> None:
        """Note in the ring that what was read is safe: the writer may write over it, the next reader goes on here."""
        words = self._known()
        words[self._slot + 1] = self._place
        words[self._slot] = self._tag

    @property
    def waiting(self) -> int:
        """Bytes that were not read yet."""
        return int(self._known()[_AT_HEAD]) - self._place

    @property
    def left(self) -> bool:
        """Whether the writer has left the ring for good."""
        return bool(self._known()[_AT_LEFT])

    @property
    def written(self) -> bool:
        """Whether the writer is still there."""
        return _is_held(self._file)

    def close(self) -> None:
        """Let go of the ring; the place that was saved stays in it."""
        if self._words is not None:
            self._words.release()
        self._map.close()
        with suppress(OSError):
            os.close(self._file)
