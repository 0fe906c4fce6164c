"""Processes of the program that tests start: forked by one process that has imported the program before.

They are as real as those that a shell starts, and begin in a hundredth of the time.
"""

from __future__ import annotations

import math
import os
import signal
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import IO

from tests.processes.nursery import NAME, SPACE
from zenoh_cbef.nodes.launch.children import Child, Nursery
from zenoh_cbef.nodes.launch.nursery import VERBS

_forking = threading.Lock()


@cache
def _nursery() -> Nursery:
    """This worker's: it ends with the worker."""
    return Nursery((*VERBS, "run", "fleet", "replay", "reestimate", "router", "status"), NAME).__enter__()


def begin() -> None:
    """Begin the nursery now, where it has not begun."""
    with _forking:
        _nursery()


def fork_on(
    command: Sequence[str], folder: Path, environment: Mapping[str, str], space: Path | None, streams: Sequence[int]
) -> Child:
    """Start the process of a command line, in a network namespace where one is given."""
    with _forking:
        place = {} if space is None else {SPACE: str(space)}
        return _nursery().fork(command, {**environment, **place}, folder, streams)


def wait_for(child: Child, timeout: float = math.inf) -> int | None:
    """The exit status of a process; None where it does not end within so many seconds."""
    until = time.monotonic() + timeout
    while (status := poll(child)) is None and time.monotonic() < until:
        time.sleep(0.01)
    return status


def poll(child: Child) -> int | None:
    """The exit status of a process, None while it runs. The nursery answers one thread at a time."""
    with _forking:
        return child.poll()


class Forked:
    """A process of a command line, with what tests use of `subprocess.Popen`."""

    def __init__(self, command: Sequence[str], folder: Path, space: Path | None = None) -> None:
        (out, told), (err, complained) = os.pipe(), os.pipe()
        with Path(os.devnull).open("rb") as nothing:
            self._child = fork_on(command, folder, {}, space, [nothing.fileno(), told, complained])
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
        return poll(self._child)

    def wait(self, timeout: float = 100) -> int:
        status = wait_for(self._child, timeout)
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
        with _forking:
            self._child.send(number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


Process = subprocess.Popen[str] | Forked
