"""Keys pressed on a terminal, one by one."""

from __future__ import annotations

import os
import re
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Mapping
from typing import Self

SPACE, RIGHT, UP, DOWN = " ", "right", "up", "down"

_ARROWS = {b"A": UP, b"B": DOWN, b"C": RIGHT}
_KEY = re.compile(rb"\x1b[\[O]([ABCD])|([^\x1b])")


class Keyboard:
    """Calls actions by the name of the key, from a thread, while it is entered. Ctrl-C stays what it is.

    Does nothing where standard input is no terminal, or one that another program has now.
    """

    def __init__(self, actions: Mapping[str, Callable[[], None]]) -> None:
        self._actions = actions
        self._terminal = sys.__stdin__.fileno() if _ours() and sys.__stdin__ is not None else None

    def __enter__(self) -> Self:
        if self._terminal is not None:
            self._before = termios.tcgetattr(self._terminal)
            tty.setcbreak(self._terminal, termios.TCSANOW)
            self._end = os.pipe()
            self._thread = threading.Thread(target=self._read, daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._terminal is not None:
            os.write(self._end[1], b".")
            self._thread.join()
            for end in self._end:
                os.close(end)
            termios.tcsetattr(self._terminal, termios.TCSANOW, self._before)

    def _read(self) -> None:
        if self._terminal is None:
            return
        while True:
            ready, _, _ = select.select([self._terminal, self._end[0]], [], [])
            if self._end[0] in ready:
                return
            try:
                pressed = os.read(self._terminal, 1024)
            except OSError:  # the terminal went away
                return
            if not pressed:
                return
            for arrow, plain in _KEY.findall(pressed):
                action = self._actions.get(_ARROWS.get(arrow, plain.decode(errors="replace")))
                if action is not None:
                    action()


def _ours() -> bool:
    """Whether standard input is a terminal that this process may read from now."""
    if sys.__stdin__ is None or not sys.__stdin__.isatty():
        return False
    try:
        return os.tcgetpgrp(sys.__stdin__.fileno()) == os.getpgrp()
    except OSError:  # no terminal that shells share out
        return True
