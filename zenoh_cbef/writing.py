"""Files that cannot be written, as sentences."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from zenoh_cbef.errors import UserError


@contextmanager
def writing(place: object, remedy: str = "choose another --output") -> Iterator[None]:
    """Raise UserError, with the remedy, where what the block writes to this place cannot be written."""
    try:
        yield
    except OSError as error:
        raise UserError(f"cannot write {place}: {error.strerror}; {remedy}") from None
