"""Where verbs print: results on standard output, everything else on standard error."""

from __future__ import annotations

import sys
from collections.abc import Iterable

from rich.console import Console

# FORCE_COLOR, which notebooks set, is a wish for colours: what moves in place fills a pipe with each of its pictures.
console = Console(force_terminal=None if sys.stdout.isatty() else False)
errors = Console(stderr=True, force_terminal=None if sys.stderr.isatty() else False)


def say(sentence: str) -> None:
    """Print a sentence on standard output, as it is."""
    console.print(sentence, highlight=False, soft_wrap=True, markup=False)


def tell(sentence: str) -> None:
    """Print a sentence on standard error, as it is."""
    errors.print(sentence, highlight=False, soft_wrap=True, markup=False)


def warn(sentences: Iterable[str]) -> None:
    """Print warnings, each a sentence."""
    for sentence in sentences:
        tell(f"warning: {sentence}")


def tell_what_lacks(sentences: Iterable[str], run: str = "") -> None:
    """Print what a log lacks, and what is therefore not scored. run: its name, where several are looked at."""
    for sentence in sentences:
        tell(f"note: {run and f'{run}: '}{sentence}")
