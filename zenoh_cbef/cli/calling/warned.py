"""Warnings of libraries as sentences for the user: without source paths, each of them once."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

_OUT_OF_RANGE = (
    "some number of the scenario is far out of proportion, and results may be meaningless; look at standard "
    "deviations, dt and positions"
)


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Until the block is left, tell warnings in a sentence each; `python -W` still decides which there are."""
    told: set[str] = set()

    def tell(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        del filename, lineno, file, line
        # NumPy's are of this category: an overflow, a division by zero, a NaN.
        words = _OUT_OF_RANGE if issubclass(category, RuntimeWarning) else " ".join(str(message).split())
        if words not in told:
            told.add(words)
            sys.stderr.write(f"warning: {words}\n")

    with warnings.catch_warnings():
        warnings.showwarning = tell
        yield
