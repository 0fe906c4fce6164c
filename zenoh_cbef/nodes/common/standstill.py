"""Faults of a process itself: it is killed, or stopped for a while. No helper process outlives it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

from zenoh_cbef.nodes.common.ending import Ending

_WAKE = """
import os, signal, sys, time
parent, until = int(sys.argv[1]), time.monotonic() + float(sys.argv[2])
while os.getppid() == parent and time.monotonic() < until:
    time.sleep(0.01)
if os.getppid() == parent:
    os.kill(parent, signal.SIGCONT)
"""


def die(step: int, back: int | None, pace: float = 0.0) -> None:
    """Be killed, after telling the launcher why, and the reader of standard error.

    back: the step at which this process is to be there again, if it is. pace: how long a step takes, s; 0 in lockstep.
    """
    away = None if back is None else back - step
    Ending("crash", away, pace * (away or 0)).tell()
    until = "" if back is None else f", until step {back}"
    sys.stderr.write(f"the scenario's crash kills this process at step {step}{until}\n")
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
