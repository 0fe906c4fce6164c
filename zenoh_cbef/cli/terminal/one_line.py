"""How far a process of a run is, in one line. Agents and targets start often, so it takes no package."""

from __future__ import annotations

import shutil
import sys
import time

_OFTEN_SECONDS, _CALM_SECONDS = 0.2, 2.0
"""From one picture to the next on a terminal, and from one line to the next elsewhere."""


class OneLine:
    """A line on a terminal that is written over; elsewhere a line now and then in which something changed."""

    def __init__(self) -> None:
        self._said, self._due, self.over = "", 0.0, sys.stderr.isatty()

    def show(self, words: str) -> None:
        """Show these words, unless others were shown just now."""
        if words == self._said or time.monotonic() < self._due:
            return
        self._said, self._due = words, time.monotonic() + (_OFTEN_SECONDS if self.over else _CALM_SECONDS)
        if self.over:  # what goes on in a second row cannot be written over
            words = f"\r{words[: shutil.get_terminal_size().columns - 1]}\033[K"
        sys.stderr.write(words if self.over else f"{words}\n")
        sys.stderr.flush()

    def close(self) -> None:
        """Leave the line."""
        if self.over and self._said:
            sys.stderr.write("\r\033[K")
            sys.stderr.flush()
        self._said = ""
