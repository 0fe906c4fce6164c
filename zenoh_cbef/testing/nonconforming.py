"""What a test of a plug-in raises."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class Nonconforming(AssertionError):
    """A plug-in does not do what runs rely on: one sentence that says what, and what to do."""


@contextmanager
def only_reading(method: str, given: str = "arrays") -> Iterator[None]:
    """Raise Nonconforming where a method writes into what it is given, which is read-only."""
    try:
        yield
    except ValueError as error:
        if "read-only" in str(error):
            raise Nonconforming(f"{method} changes the {given} that it is given; copy them first") from None
        raise
