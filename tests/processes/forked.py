"""Processes of the program that tests start: forked by one process that has imported the program before.

They are as real as those that a shell starts, and begin in a hundredth of the time.
"""

from __future__ import annotations

import os
import signal
import subprocess
import threading
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import IO

from zenoh_cbef.nodes.launch.children import Nursery
from zenoh_cbef.nodes.launch.nursery import VERBS


@cache
def _nursery() -> Nursery:
    """This worker's: it ends with the worker."""
    return Nursery((*VERBS, "run", "fleet", "replay", "reestimate")).__enter__()


class Forked:
    """A process of a command line, with what tests use of `subprocess.Popen`."""

    def __init__(self, command: Sequence[str], folder: Path) -> None:
        (out, told), (err, complained) = os.pipe(), os.pipe()
        with Path(os.devnull).open("rb") as nothing:
            self._child = _nursery().fork(command, {}, folder, [nothing.fileno(), told, complained])
        for end in (told, complained):
            os.close(end)
        self.pid = self._child.pid
        self.stdout: IO[str] = os.fdopen(out, encoding="utf-8")
        self.stderr: IO[str] = os.fdopen(err, encoding="utf-8")

    @property
    def returncode(self) -> int:
        """Of a process that has ended."""
        status = self.poll()
        assert status is not None
        return status

    def poll(self) -> int | None:
        return self._child.poll()

    def wait(self, timeout: float = 100) -> int:
        status = self._child.wait(timeout)
        if status is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout)
        return status

    def communicate(self, timeout: float = 100) -> tuple[str, str]:
        """What it prints until its end."""
        texts = ["", ""]

        def read(number: int, pipe: IO[str]) -> None:
            with suppress(ValueError):  # the test has ended, and closed it
                texts[number] = pipe.read()

        readers = [
            threading.Thread(target=read, args=pair, daemon=True) for pair in enumerate((self.stdout, self.stderr))
        ]
        for reader in readers:
            reader.start()
        self.wait(timeout)
        for reader in readers:
            reader.join(timeout)
        return texts[0], texts[1]

    def send_signal(self, number: int) -> None:
        self._child.send(number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


Process = subprocess.Popen[str] | Forked
