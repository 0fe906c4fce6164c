"""How far a verb's work has got: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import Progress

from zenoh_cbef.cli.terminal.console import errors, tell

_SECONDS = 10.0
"""From one line to the next."""


class Lines:
    """A line now and then where there is no terminal to show a bar."""

    def __init__(self, what: str) -> None:
        self._what, self._told, self._any = what, time.monotonic(), False

    def show(self, done: int, total: int) -> None:
        """Take in how much is done; where a line was told, the end is told, too."""
        due = time.monotonic() - self._told >= _SECONDS or (self._any and done == total)
        if not errors.is_terminal and due:
            self._told, self._any = time.monotonic(), done < total
            tell(f"{self._what}: {done} of {total}")


@contextmanager
def bar(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A bar while the block runs; it gets how much is done, of `total`."""
    lines = Lines(what)
    with Progress(console=errors, transient=True, disable=not errors.is_terminal) as progress:
        task = progress.add_task(what, total=total)

        def show(done: int) -> None:
            progress.update(task, completed=done)
            lines.show(done, total)

        yield show
