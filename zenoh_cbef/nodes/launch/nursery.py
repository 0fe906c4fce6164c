"""A process that has imported what the processes of a run need, and forks one for each order.

So a process begins within milliseconds, and shares the memory of all that it does not change. A fork is sound only
where the forking process has one thread: this one opens no session, and starts no thread. It is itself a fork of a
caller that has one thread, which saves its imports, too. The orders come through its standard input, a socket: the
length of a JSON text with the three standard streams of the new process, then the text. What it sends back are pairs
of numbers: the pid of a process that was started, with STARTED, or has ended, with its exit status, negative for a
signal. It ends when the socket is closed.
"""

from __future__ import annotations

import gc
import json
import os
import runpy
import select
import signal
import socket
import struct
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import NoReturn

NAME = "zenoh_cbef.nodes.launch.nursery"
STARTED = 1 << 20
LENGTH, PAIR = struct.Struct("!I"), struct.Struct("!qi")
ROOM = "-" * 1000
"""An argument that is there for its length: the words of a forked process take its place in the list of processes."""
_STREAMS = 3
VERBS = ("target", "record", "agent")
"""The verbs of a run's processes."""
_ENDS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
_CALLER = "zenoh_cbef.cli"
"""Modules that know the caller's command line and terminal."""
_PLACES = 48, 49, 51
"""Where /proc/self/stat says where arguments begin and end, and where the environment ends."""


def fork_here(orders: socket.socket, verbs: Sequence[str]) -> int | None:
    """Fork the nursery from this process; its pid. None where this process has threads, or forks are not enough.

    orders: the end of the socket that the nursery reads from. verbs: those that it is to fork.
    """
    if not _forks() or len([*Path("/proc/self/task").iterdir()]) > 1:
        return None
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    pid = os.fork()
    if pid:
        return pid
    try:
        os.setpgid(0, 0)  # Ctrl-C is for the caller, who ends the others
        os.dup2(orders.fileno(), 0)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.closerange(_STREAMS, 1 << 16)
        # What the caller may have put in their place is the caller's.
        sys.stdout, sys.stderr = sys.__stdout__ or sys.stdout, sys.__stderr__ or sys.stderr
        for name in [name for name in sys.modules if name.startswith(_CALLER)]:
            del sys.modules[name]
        main(verbs)
        os._exit(0)
    except BaseException:  # noqa: BLE001 - nothing of the caller may go on in the child
        traceback.print_exc()
    finally:
        os._exit(1)


def serve(orders: socket.socket) -> None:
    """Fork a process for each order, and tell of ends, until the caller is gone."""
    for number in _ENDS:
        signal.signal(number, signal.SIG_IGN)  # who ends the caller by its words may mean this process, too
    woken, wake = os.pipe()
    for end in (woken, wake):
        os.set_blocking(end, False)
    signal.set_wakeup_fd(wake)
    signal.signal(signal.SIGCHLD, lambda _signum, _frame: None)
    while True:
        ready, _, _ = select.select([orders.fileno(), woken], [], [])
        if orders.fileno() in ready:
            head, streams, _, _ = socket.recv_fds(orders, LENGTH.size, _STREAMS)
            if not head:
                return
            orders.sendall(PAIR.pack(_fork(_exactly(orders, LENGTH.unpack(head)[0]), streams), STARTED))
        if woken in ready:
            with suppress(BlockingIOError):
                os.read(woken, 4096)
        for pid, status in _ended():
            orders.sendall(PAIR.pack(pid, status))


def _exactly(orders: socket.socket, length: int) -> bytes:
    text = b""
    while len(text) < length and (more := orders.recv(length - len(text))):
        text += more
    return text


def _ended() -> list[tuple[int, int]]:
    found = []
    with suppress(ChildProcessError):
        while (one := os.waitpid(-1, os.WNOHANG))[0]:
            found.append((one[0], os.waitstatus_to_exitcode(one[1])))
    return found


def _fork(text: bytes, streams: list[int]) -> int:
    pid = os.fork()
    if pid == 0:
        try:
            become(streams, **json.loads(text))
        except BaseException:  # noqa: BLE001 - nothing of the parent may go on in the child
            traceback.print_exc()
        finally:
            os._exit(1)
    for stream in streams:
        os.close(stream)
    return pid


def become(streams: list[int], command: list[str], environment: dict[str, str], folder: str) -> NoReturn:
    """Be the process of a command line, in the folder and the environment of the process that asked for it."""
    os.setsid()
    signal.set_wakeup_fd(-1)
    for number in (signal.SIGCHLD, *_ENDS):
        signal.signal(number, signal.SIG_DFL)
    for place, stream in enumerate(streams):
        os.dup2(stream, place)
    os.closerange(_STREAMS, 1 << 16)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = ["zenoh-cbef", *command]
    words = [sys.executable, "-m", "zenoh_cbef", *command]
    if not _forks():
        os.execv(sys.executable, words)  # noqa: S606 - the words are a list
    _show(words)
    try:
        runpy.run_module("zenoh_cbef", run_name="__main__")
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    sys.stdout.flush()
    os._exit(status)


def _forks() -> bool:
    """Whether a fork can do without exec: elsewhere the system's own libraries have threads."""
    return sys.platform == "linux"


def _show(words: list[str]) -> None:
    """Let the list of processes show these words.

    They are written over the arguments that the program began with. Where these are too short, they go on over the
    environment behind them, which is no longer in use. Then the last argument does not end with a zero, and Linux shows
    one text up to the first zero.
    """
    with suppress(OSError, IndexError, ValueError, ImportError, MemoryError):
        import ctypes  # noqa: PLC0415 - where memory may not be written and executed it can fail

        fields = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        # The fields after the name, of which the first is the third.
        begin, end, environment_end = (int(fields[one - 3]) for one in _PLACES)
        text = b"\0".join(map(os.fsencode, words)) + b"\0"
        if len(text) > end - begin:
            text = text.replace(b"\0", b" ")[: environment_end - begin - 1]
            end = environment_end
        ctypes.memset(begin, 0, end - begin)
        ctypes.memmove(begin, text, len(text))


def main(verbs: Sequence[str]) -> None:
    """Import and make what these verbs need first, so that no process has to."""
    orders = socket.socket(fileno=os.dup(0))
    os.environ["TERM"] = "dumb"  # what its processes print goes to files
    if _forks():
        for name in ("zenoh_cbef.cli.calling.main", "zenoh_cbef.cli.calling.warned"):
            import_module(name)
        for verb in verbs:
            import_module("zenoh_cbef.cli.calling.verbs").rehearse(verb)
        import_module("zenoh_cbef.nodes.launch.rehearsal").rehearse()
    gc.collect()
    gc.freeze()  # a collection in a forked process leaves these pages alone
    serve(orders)


if __name__ == "__main__":
    main(sys.argv[2:])
