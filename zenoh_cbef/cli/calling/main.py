"""The entry point: what ends a verb early becomes one sentence and an exit status, never a traceback.

Ctrl-C can come at any time, so nothing that takes time to import is imported before it is provided for.
"""

from __future__ import annotations

import atexit
import errno
import gc
import os
import sys
from importlib import import_module

from zenoh_cbef.cli.calling.interrupts import INTERRUPTED, end_deaf, leave_at_once
from zenoh_cbef.errors import Interrupted, UserError

_MISTAKE = 2
_READER_GONE = 1
_REMEDIES = {
    errno.EACCES: "change its permissions, or name another",
    errno.EPERM: "change its permissions, or name another",
    errno.EROFS: "name another place",
    errno.ENOSPC: "make room, or name another place",
    errno.EDQUOT: "make room, or name another place",
    errno.EISDIR: "name a file",
    errno.ENOTDIR: "a folder of its path is a file; name another place",
    errno.EMFILE: "raise the limit of open files, as with 'ulimit -n 4096'",
    errno.ENFILE: "close other programs, or raise the system's limit of open files",
}


def main() -> None:
    """Run the verb of the command line.

    Exits with the verb's own status, 2 for a mistake or where something cannot be read or written, 130 after Ctrl-C,
    and 1 where the reader of a pipe has gone.
    """
    gc.disable()  # What is imported stays: to look for circles in it takes an eighth of the time.
    _open_streams()
    leave_at_once()
    atexit.register(end_deaf)
    status = _run()
    sys.exit(_flushed(status))


def _open_streams() -> None:
    """Open what the caller closed, to nowhere: else a log gets the number of a stream, and words of Zenoh in it."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is this one
    sys.stdout = sys.stdout or os.fdopen(1, "w")
    sys.stderr = sys.stderr or os.fdopen(2, "w")


def _run() -> int:
    # The matrices are six by six, cores are few, and a process with one thread can fork.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Pydantic would read what every installed package says of itself, to find its own plug-ins.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    try:
        try:
            if {"COMP_WORDS", "COMP_CWORD"} <= os.environ.keys():  # bash asks what may come next
                import_module("zenoh_cbef.cli.options.completing").mend_words()
            verbs = import_module("zenoh_cbef.cli.calling.verbs")
            with import_module("zenoh_cbef.cli.calling.warned").plain_warnings():
                verbs.call()
        finally:
            leave_at_once()  # an exception among the words about another one would be a traceback
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except (Interrupted, KeyboardInterrupt):
        return _told("interrupted", INTERRUPTED)
    except BrokenPipeError:
        return _READER_GONE
    except (UserError, OSError, ArithmeticError, MemoryError, ValueError) as error:
        return _told(_sentence(error))
    return 0


def _sentence(error: Exception) -> str:
    """What to tell of an error. Raises it again where it is a mistake of this program."""
    if isinstance(error, UserError):
        return str(error)
    if isinstance(error, OSError):
        if error.errno == errno.ENOENT and not error.filename:
            return "the working directory is no longer there; change to another one"
        what = f"cannot use {error.filename}" if error.filename else "cannot write the output"
        return f"{what}: {error.strerror or error}; {_REMEDIES.get(error.errno or 0, 'check it, or name another')}"
    if isinstance(error, MemoryError):
        return "there is not enough memory; lower steps or agents.count, or end other programs"
    # NumPy's LinAlgError is a ValueError, and NumPy is not imported for this.
    if isinstance(error, ArithmeticError) or type(error).__name__ == "LinAlgError":
        return (
            f"the arithmetic breaks down ({error}): some number of the scenario is far out of proportion; "
            "look at standard deviations, dt and positions"
        )
    raise error


def _told(sentence: str, status: int = _MISTAKE) -> int:
    try:
        sys.stderr.write(f"zenoh-cbef: {sentence}\n")
    except OSError:  # standard error is full, too
        return status
    return status


def _flushed(status: int) -> int:
    """Write out what is held back still, as a full disk may show only now. Returns the exit status."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as error:
            gone = isinstance(error, BrokenPipeError)
            if status != _MISTAKE:
                status = (status or _READER_GONE) if gone else _told(_sentence(error))
            # Python would try again when it ends, and complain.
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    return status
