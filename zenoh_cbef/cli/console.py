"""Where verbs print: results on standard output, everything else on standard error."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from textwrap import fill

from rich.console import Console

from zenoh_cbef.numbers import number

__all__ = ["console", "errors", "list_named", "number", "tell", "tell_what_lacks"]

console = Console()
errors = Console(stderr=True)


def list_named(described: Mapping[str, str]) -> None:
    """Print names and what each stands for, a line each; on a terminal folded to its width."""
    width = console.width if console.is_terminal else sys.maxsize
    for name, words in described.items():
        print(fill(f"{name:10} {words}", width, subsequent_indent=" " * 11, break_long_words=False))


def tell(sentence: str) -> None:
    """Print a sentence on standard error, as it is."""
    errors.print(sentence, highlight=False, soft_wrap=True, markup=False)


def tell_what_lacks(sentences: Iterable[str], run: str = "") -> None:
    """Print what a log lacks, and what is therefore not scored. run: its name, where several are looked at."""
    for sentence in sentences:
        tell(f"note: {run and f'{run}: '}{sentence}")
