"""The recorder of a fleet: it writes the log of the agents of its host."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Self

from zenoh_cbef.nodes.common.node import FLEET, LEASH

_POLITE_SECONDS = 8.0
_LOOK_SECONDS = 0.1


class HostRecorder:
    """A recorder process. Use as a context manager: leaving it ends the process, which ends with this one in any case.

    command: its command line. Its words go to this process's standard error.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._command = list(command)

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "zenoh_cbef", *self._command],
            stdin=subprocess.PIPE,
            stdout=sys.stderr,
            env=os.environ | {LEASH: FLEET, "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,  # Ctrl-C is for the caller, who ends it last
        )
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.terminate()
        try:
            self._process.wait(_POLITE_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()

    def wait(self, asked_to_stop: Callable[[], int]) -> int:
        """Wait until it has written its log, and for as long as it stays; its exit status.

        asked_to_stop: how often the user asked; it then ends at once, with its log.
        """
        told = 0
        while True:
            try:
                return self._process.wait(_LOOK_SECONDS)
            except subprocess.TimeoutExpired:
                asked = asked_to_stop()
            if asked > told:
                told = asked
                self._process.send_signal(signal.SIGTERM if told == 1 else signal.SIGKILL)
