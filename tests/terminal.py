"""A program on a terminal of its own."""

import fcntl
import os
import pty
import select
import struct
import subprocess
import termios
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self


class Terminal:
    """A terminal of its own session with a program in it, and what that has written. Use as a context manager."""

    def __init__(self, command: Sequence[str], *, folder: Path | None = None, width: int = 120, height: int = 40):
        self.leader, follower = pty.openpty()
        fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", height, width, 0, 0))
        self.process = subprocess.Popen(
            command,
            cwd=folder,
            stdin=follower,
            stdout=follower,
            stderr=follower,
            env=os.environ | {"TERM": "xterm"},
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(follower, termios.TIOCSCTTY, 0),  # noqa: PLW1509
        )
        os.close(follower)
        self._raw, self.seen = b"", ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, text: str) -> None:
        os.write(self.leader, text.encode())

    def read_until(self, condition: Callable[[str], bool]) -> None:
        """Read until what was written fulfils a condition, or the program ends."""
        until = time.monotonic() + 60
        while not condition(self.seen):
            assert time.monotonic() < until, self.seen
            if select.select([self.leader], [], [], 0.2)[0]:
                try:
                    self._raw += os.read(self.leader, 65536)
                except OSError:  # the program was its last user
                    return
                self.seen = self._raw.decode(errors="replace")

    def leave(self) -> int:
        self.read_until(lambda _seen: False)
        return self.process.wait(timeout=100)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self.leader)
