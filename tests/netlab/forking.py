"""The verbs of recipes without the start of Python that each would need: a program that has a nursery fork them.

The recipes' shells call `zenoh-cbef`, which is a script here: it hands its arguments, folder and streams to this
process, whose nursery forks the verb on the host where the script runs, and it ends as the verb does.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tests.processes.forked import begin, fork_on, wait_for

_SCRIPT = """#!{python} -IS
import json, os, socket, sys
with socket.socket(socket.AF_UNIX) as caller:
    caller.connect({place!r})
    socket.send_fds(caller, [b"."], [0, 1, 2])
    text = json.dumps([os.getpid(), os.getcwd(), dict(os.environ), sys.argv[1:]]).encode()
    caller.sendall(len(text).to_bytes(4, "big") + text)
    told = caller.recv(4, socket.MSG_WAITALL)
sys.exit(int.from_bytes(told, "big", signed=True) if len(told) == 4 else 1)
"""


def _exactly(caller: socket.socket, length: int) -> bytes:
    found = b""
    while len(found) < length and (more := caller.recv(length - len(found))):
        found += more
    return found


def _serve(caller: socket.socket) -> None:
    with caller:
        _, streams, _, _ = socket.recv_fds(caller, 1, 3)
        length = int.from_bytes(_exactly(caller, 4), "big")
        pid, folder, environment, words = json.loads(_exactly(caller, length))
        child = fork_on(words, Path(folder), environment, Path(f"/proc/{pid}/ns/net"), streams)
        for stream in streams:
            os.close(stream)
        status = wait_for(child)
        assert status is not None
        with suppress(BrokenPipeError):  # the test has ended the script
            caller.sendall((status if status >= 0 else 128 - status).to_bytes(4, "big", signed=True))


@contextmanager
def forking_commands(folder: Path) -> Iterator[Path]:
    """A folder with `zenoh-cbef` for the search path of shells, which works until the block is left."""
    begin()  # a nursery that began while streams arrive would hold them open, and the test would wait for their end
    folder.mkdir()
    place, script = folder / "socket", folder / "zenoh-cbef"
    script.write_text(_SCRIPT.format(python=sys.executable, place=str(place)))
    script.chmod(0o755)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(place))
        listening.listen(100)

        def accept() -> None:
            try:
                while True:
                    threading.Thread(target=_serve, args=(listening.accept()[0],), daemon=True).start()
            except OSError:  # the block is left
                return

        threading.Thread(target=accept, daemon=True).start()
        yield folder
        listening.shutdown(socket.SHUT_RDWR)
