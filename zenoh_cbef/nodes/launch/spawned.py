"""A process of this program that is started from nothing, to be waited for and ended as one of the nursery is."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO


class Spawned:
    """A process whose standard input, its leash, ends with this one.

    words: the file that its standard error is appended to. tells: whether the caller reads what it prints (`output`).
    """

    def __init__(self, command: Sequence[str], environment: Mapping[str, str], words: Path, *, tells: bool) -> None:
        with words.open("ab") as file:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "zenoh_cbef", *command],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE if tells else subprocess.DEVNULL,
                stderr=file,
                # One thread per process: the matrices are six by six, and cores are few.
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1", **environment},
                start_new_session=True,
            )
        self.pid = self._process.pid

    @property
    def output(self) -> IO[bytes]:
        """What it prints. Raises RuntimeError where it was not to tell."""
        if self._process.stdout is None:
            raise RuntimeError("the process was started without a pipe")
        return self._process.stdout

    def poll(self) -> int | None:
        """Its exit status, negative for a signal; None while it runs."""
        return self._process.poll()

    def wait(self, seconds: float) -> int | None:
        """Its exit status; None where it does not end within so many seconds."""
        try:
            return self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return None

    def send(self, number: int) -> None:
        """Send it a signal, if it still runs."""
        self._process.send_signal(number)

    def close(self) -> None:
        """Let go of its pipes."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
