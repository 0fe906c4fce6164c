"""Lists of what comes with the program. Without rich, as these are the shortest of all calls."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from shutil import get_terminal_size
from textwrap import fill


def list_named(described: Mapping[str, str]) -> None:
    """Print names and what each stands for, a line each; on a terminal folded to its width."""
    width = get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
    for name, words in described.items():
        print(fill(f"{name:10} {words}", width, subsequent_indent=" " * 11, break_long_words=False))
