"""What Ctrl-C does: before a verb begins and after its end it ends the program at once; in between it is an exception.

Out of the midst of an import an exception would come as a traceback, or as another error. So this is imported first,
and imports next to nothing itself.
"""

from __future__ import annotations

import os
from importlib import import_module

# What Python's own `signal` is made of: that takes 15 ms for its names, in which Ctrl-C would be a traceback.
_signal = import_module("_signal")

INTERRUPTED = 130
"""Exit status after Ctrl-C."""


def leave_at_once() -> None:
    """Let Ctrl-C end the program from here on. A shell's background job, or one under nohup, still ignores it."""
    if _signal.getsignal(_signal.SIGINT) != _signal.SIG_IGN:
        _signal.signal(_signal.SIGINT, _leave)


def raise_from_here() -> None:
    """Let Ctrl-C raise KeyboardInterrupt from here on, where it would end the program."""
    if _signal.getsignal(_signal.SIGINT) is _leave:
        _signal.signal(_signal.SIGINT, _signal.default_int_handler)


def end_deaf() -> None:
    """At exit, ignore Ctrl-C: Python takes its handlers out next, and would die of one.

    Registered before all else, it is called after all else.
    """
    if _signal.getsignal(_signal.SIGINT) is _leave:
        _signal.signal(_signal.SIGINT, _signal.SIG_IGN)


def _leave(_signum: int, _frame: object) -> None:
    try:
        os.write(2, b"zenoh-cbef: interrupted\n")
    finally:
        os._exit(INTERRUPTED)
