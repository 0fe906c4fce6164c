"""The entry point: what ends a verb early becomes one sentence and an exit status, never a traceback.

Ctrl-C can come at any time, so nothing that takes time to import is imported before it is provided for.
"""

from __future__ import annotations

import errno
import os
import sys
from importlib import import_module

from zenoh_cbef.errors import Interrupted, UserError

TYPE_CHECKING = False  # as in `typing`, which takes as long
if TYPE_CHECKING:
    import typer

# What Python's own `signal` is made of: that takes 15 ms for its names, in which Ctrl-C would be a traceback.
_signal = import_module("_signal")

_INTERRUPTED = 130
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


def build(verb: str | None) -> typer.Typer:
    """The application with one verb, or with all."""
    application: typer.Typer = import_module("zenoh_cbef.cli.verbs").build(verb)
    return application


def main() -> None:
    """Run the verb of the command line.

    Exits with the verb's own status, 2 for a mistake or where something cannot be read or written, 130 after Ctrl-C,
    and 1 where the reader of a pipe has gone.
    """
    _open_streams()
    # A shell's background job, or one under nohup, does not heed Ctrl-C.
    heeds = _signal.getsignal(_signal.SIGINT) != _signal.SIG_IGN
    if heeds:
        _signal.signal(_signal.SIGINT, _leave)
    status = _run(heeds=heeds)
    if heeds:
        _signal.signal(_signal.SIGINT, _leave)
    sys.exit(_flushed(status))


def _open_streams() -> None:
    """Let what the caller closed lead nowhere: a log would get the number of a stream, and words of Zenoh in it."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is this one
    sys.stdout = sys.stdout or os.fdopen(1, "w")
    sys.stderr = sys.stderr or os.fdopen(2, "w")


def _leave(_signum: int, _frame: object) -> None:
    """Leave at once, while nothing is begun or all is done: an exception would come out of the midst of an import."""
    try:
        os.write(2, b"zenoh-cbef: interrupted\n")
    finally:
        os._exit(_INTERRUPTED)


def _run(*, heeds: bool) -> int:
    try:
        application = build(sys.argv[1] if len(sys.argv) > 1 else None)
        if heeds:
            _signal.signal(_signal.SIGINT, _signal.default_int_handler)
        with import_module("zenoh_cbef.cli.warned").plain_warnings():
            application(prog_name="zenoh-cbef")
    except SystemExit as ended:
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except (Interrupted, KeyboardInterrupt):
        return _told("interrupted", _INTERRUPTED)
    except BrokenPipeError:
        return _READER_GONE
    except (UserError, OSError, ArithmeticError, MemoryError, ValueError) as error:
        return _told(_sentence(error))
    return 0


def _sentence(error: Exception) -> str:
    """What to tell of an error. Raises it again where it is none of the user's."""
    if isinstance(error, UserError):
        return str(error)
    if isinstance(error, OSError):
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
