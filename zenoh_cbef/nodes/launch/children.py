"""Processes of this program that the nursery forks, to be waited for and ended as those of `subprocess` are."""

from __future__ import annotations

import json
import os
import select
import socket
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Self

from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.launch.nursery import LENGTH, NAME, PAIR, ROOM, STARTED, VERBS, fork_here

_LOOK_SECONDS = 0.01
_TAIL = 4000


def last_words(place: Path) -> str:
    """The last line of a file into which a process wrote its words; "" where it wrote none."""
    text = place.read_bytes()[-_TAIL:].decode(errors="replace").strip()
    return text.splitlines()[-1].removeprefix("zenoh-cbef: ") if text else ""


def how_ended(status: int) -> str:
    """An exit status, negative for a signal, in words."""
    return f"was killed by signal {-status}" if status < 0 else f"ended with status {status}"


class Child:
    """A process that the nursery started."""

    def __init__(self, nursery: Nursery, pid: int) -> None:
        self._nursery, self.pid = nursery, pid

    def poll(self) -> int | None:
        """Its exit status, negative for a signal; None while it runs."""
        return self._nursery.status(self.pid)

    def wait(self, seconds: float) -> int | None:
        """Its exit status; None where it does not end within so many seconds."""
        until = time.monotonic() + seconds
        while (status := self.poll()) is None and time.monotonic() < until:
            time.sleep(_LOOK_SECONDS)
        return status

    def send(self, number: int) -> None:
        """Send it a signal, if it still runs."""
        if self.poll() is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)


class Nursery:
    """Starts processes. Use as a context manager: leaving it ends the nursery, not the processes.

    All of them have one standard input, which ends with this process: their leash. verbs: those that begin at once;
    others are imported by each process. program: the module that is the nursery, None: this program's.
    """

    def __init__(self, verbs: Sequence[str] = VERBS, program: str | None = None) -> None:
        self._verbs, self._program = verbs, program

    def __enter__(self) -> Self:
        self._statuses: dict[int, int | None] = {}
        self._orders, theirs = socket.socketpair()
        self._leash, self._hold = os.pipe()
        with theirs:
            forked = None if self._program else fork_here(theirs, self._verbs)
            self.pid = forked or _begun(theirs, self._verbs, self._program or NAME)
        return self

    def __exit__(self, *_: object) -> None:
        self._orders.close()
        for end in (self._leash, self._hold):
            os.close(end)
        with suppress(ChildProcessError):
            os.waitpid(self.pid, 0)

    def start(
        self, command: list[str], environment: Mapping[str, str], words: Path, output: int | None = None
    ) -> Child:
        """Start the process of a command line. words: the file that its standard error is appended to.

        output: the file that it prints to, None: it prints nowhere. Raises UserError where the nursery has ended.
        """
        with words.open("ab") as file, Path(os.devnull).open("ab") as nowhere:
            streams = [self._leash, nowhere.fileno() if output is None else output, file.fileno()]
            return self.fork(command, environment, Path.cwd(), streams)

    def fork(
        self, command: Sequence[str], environment: Mapping[str, str], folder: Path, streams: Sequence[int]
    ) -> Child:
        """Start the process of a command line in a folder. streams: its standard input, output and error.

        Raises UserError where the nursery has ended.
        """
        order = {"command": [*command], "environment": os.environ | environment, "folder": str(folder)}
        text = json.dumps(order).encode()
        try:
            socket.send_fds(self._orders, [LENGTH.pack(len(text))], streams)
            self._orders.sendall(text)
            while (told := self._next())[1] != STARTED:
                self._statuses[told[0]] = told[1]
        except OSError:
            raise UserError("the process that starts all others has ended; start the run again") from None
        self._statuses[told[0]] = None
        return Child(self, told[0])

    def status(self, pid: int) -> int | None:
        """The exit status of a process that was started here; None while it runs."""
        while select.select([self._orders], [], [], 0)[0]:
            try:
                ended, status = self._next()
            except OSError:  # it cannot tell any more
                self._statuses |= {one: -9 for one, known in self._statuses.items() if known is None}
                break
            self._statuses[ended] = status
        return self._statuses[pid]

    def _next(self) -> tuple[int, int]:
        pair = self._orders.recv(PAIR.size, socket.MSG_WAITALL)
        if len(pair) < PAIR.size:
            raise ConnectionResetError
        pid, status = PAIR.unpack(pair)
        return pid, status


def _begun(orders: socket.socket, verbs: Sequence[str], program: str) -> int:
    """Begin a nursery from nothing, for a caller that has threads; its pid."""
    return os.posix_spawn(
        sys.executable,
        [sys.executable, "-m", program, ROOM, *verbs],
        # One thread per process: the matrices are six by six, and cores are few.
        os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        file_actions=[
            (os.POSIX_SPAWN_DUP2, orders.fileno(), 0),
            (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0),
        ],
        setpgroup=0,  # Ctrl-C is for the caller, who ends the others
    )
