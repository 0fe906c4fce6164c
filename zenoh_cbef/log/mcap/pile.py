"""Records of a file's summary, which grows with the file: kept in memory, and beyond some size on the disk."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path

_IN_MEMORY = 1 << 16


class Pile:
    """Bytes that are added one after the other, and read when all are there.

    They are in a nameless file in `folder` that ends with this process. Those that do not fit there stay in memory.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._fresh = bytearray()
        self._file: int | None = None
        self._stored = 0

    def add(self, record: bytes) -> None:
        """Add a record at the end."""
        self._fresh += record
        if len(self._fresh) >= _IN_MEMORY:
            with suppress(OSError):
                self._store()

    @property
    def in_memory(self) -> int:
        """How many bytes are in memory."""
        return len(self._fresh)

    def _store(self) -> None:
        if self._file is None:
            self._file, name = tempfile.mkstemp(prefix=".index-", dir=self._folder)
            Path(name).unlink()
        while self._fresh:
            written = os.pwrite(self._file, self._fresh, self._stored)
            self._stored += written
            del self._fresh[:written]

    def read(self) -> bytes:
        """All of it, in order. Raises OSError where it cannot be read back."""
        stored = bytearray()
        while self._file is not None and len(stored) < self._stored:
            portion = os.pread(self._file, self._stored - len(stored), len(stored))
            if not portion:
                raise OSError(f"what was put aside in {self._folder} is gone")
            stored += portion
        return bytes(stored + self._fresh)

    def close(self) -> None:
        """Close the temporary file."""
        if self._file is not None:
            os.close(self._file)
