"""The cable of a receiver on a serial port: a pseudo-terminal that is plugged in and out."""

from __future__ import annotations

import fcntl
import os
import pty
import struct
import termios
import threading
import time
import tty
from pathlib import Path

_MUCH = 1 << 18
"""More bytes than a pseudo-terminal and what reads it keep: once they are written, all bytes before them are read."""
_NOISE = b"\n"
_LONG = 200.0


class Cable:
    """A tag's end of a cable to a port, which is there while the cable is plugged. over: ends any waiting."""

    def __init__(self, port: Path, over: threading.Event | None = None) -> None:
        self._port, self._over = port, threading.Event() if over is None else over

    def plug(self) -> None:
        """Plug it in, and wait until a program has opened the port.

        That program drops what came before. So a byte is there first, and the port is ready when it is gone.
        """
        self._tag, self._end = pty.openpty()
        tty.setraw(self._end)
        os.write(self._tag, _NOISE)
        self._await(1)
        self._port.symlink_to(os.ttyname(self._end))
        self._await(0)

    def write(self, data: bytes) -> None:
        """Send bytes; waits where they are not read."""
        while data:
            data = data[os.write(self._tag, data) :]

    def unplug(self, begun: bytes = b"") -> None:
        """Take it out when everything is read but for what has begun."""
        self.write(_NOISE * _MUCH)
        self.write(begun)
        self.close()

    def close(self) -> None:
        """Take it out."""
        self._port.unlink()
        os.close(self._end)
        os.close(self._tag)

    def _await(self, count: int) -> None:
        until = time.monotonic() + _LONG
        while struct.unpack("i", fcntl.ioctl(self._end, termios.FIONREAD, bytes(4)))[0] != count:
            assert time.monotonic() < until, "no program opens the port"
            if self._over.wait(0.005):
                return
