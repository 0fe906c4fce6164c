"""Faults of a process itself: it is killed, or stopped for a while. Nothing of either outlives it."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys

KILLED = "the scenario's crash kills this process"
"""How the last words of a process begin that its scenario killed."""


def returns_after(words: str) -> int | None:
    """How many steps after its death a process is to be there again, from its last words; None: it is not."""
    found = re.search(r"at step (\d+), until step (\d+)$", words)
    return None if found is None else int(found[2]) - int(found[1])


_WAKE = """
import os, signal, sys, time
parent, until = int(sys.argv[1]), time.monotonic() + float(sys.argv[2])
while os.getppid() == parent and time.monotonic() < until:
    time.sleep(0.01)
if os.getppid() == parent:
    os.kill(parent, signal.SIGCONT)
"""


def die(step: int, back: int | None) -> None:
    """Be killed, after saying so where whoever started this process looks for its last words.

    back: the step at which it is to be there again, if it is.
    """
    sys.stderr.write(f"{KILLED} at step {step}" + ("" if back is None else f", until step {back}") + "\n")
    sys.stderr.flush()
    os.kill(os.getpid(), signal.SIGKILL)


def stand_still(seconds: float) -> None:
    """Be stopped (SIGSTOP), every thread of it, and continued (SIGCONT) by a child after so many seconds."""
    waker = subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", _WAKE, str(os.getpid()), str(seconds)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.kill(os.getpid(), signal.SIGSTOP)
    waker.wait()
